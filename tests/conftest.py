"""Fixtures of all tests: nothing survives a test, and a real broker."""

import asyncio
import contextlib
import gc
import inspect
import os
import signal
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import hypothesis
import pytest
from xdist.scheduler import LoadFileScheduling

from tests import programs, shared, warm_start
from tests.forked_workers import ForkedWorkers
from tests.mosquitto import Mosquitto

GRACE_S = 2.0
# Folders, and a file, that compute for many seconds.
LONG = ("benchmarks/test_targets.py", "lab/diagnosis", "lab/identification")
# Files of many tests that wait for real time, and share nothing.
WAITING = ("drivers/text_line/test_driver.py", "drivers/microscribe/test_driver.py")
LINKS = pytest.StashKey[Path]()
SHARED = pytest.StashKey["TemporaryDirectory[str]"]()
WORKERS = pytest.StashKey[ForkedWorkers]()
# How long an example takes says how busy this machine is. Each run draws others; many
# more are run by `make fuzz`: --hypothesis-profile=thorough.
hypothesis.settings.register_profile("quick", deadline=None, max_examples=25)
hypothesis.settings.register_profile("thorough", deadline=None, max_examples=1000)
hypothesis.settings.load_profile("quick")
# A shell's job in the background ignores Ctrl-C; the programs that we start must not.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_configure(config: pytest.Config) -> None:
    """Make the folder of shared results, in the process that starts the workers."""
    gc.disable()  # until all tests are imported: what that makes stays
    if not hasattr(config, "workerinput"):
        config.stash[SHARED] = TemporaryDirectory(prefix="traverse-tests-")
        os.environ[shared.FOLDER] = config.stash[SHARED].name


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_setupnodes(config: pytest.Config, specs: list[Any]) -> None:
    """Fork workers from one process that imports all tests."""
    workers = ForkedWorkers(Path(config.stash[SHARED].name), config.args)
    config.stash[WORKERS] = workers
    for spec in specs:
        spec.python = workers.interpreter


def pytest_unconfigure(config: pytest.Config) -> None:
    if WORKERS in config.stash:
        config.stash[WORKERS].close()
    if SHARED in config.stash:
        del os.environ[shared.FOLDER]
        config.stash[SHARED].cleanup()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--required",
        default="",
        help="groups of programs whose tests fail, not skip, where one is missing",
    )


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    needed = _needed(item)
    for group in sorted(needed):
        if lacking := ", ".join(programs.missing(group)):
            end = (
                pytest.fail
                if group in item.config.getoption("--required").split()
                else pytest.skip
            )
            end(f"{lacking} missing; try: sh deploy/debian-packages.sh {group}")
    if LINKS not in item.config.stash:
        factory = item.config._tmp_path_factory  # type: ignore[attr-defined]
        item.config.stash[LINKS] = factory.mktemp("programs")
    os.environ["PATH"] = programs.search_path(needed, item.config.stash[LINKS])


def _needed(item: pytest.Item) -> frozenset[str]:
    return frozenset(g for mark in item.iter_markers("needs") for g in mark.args)


def _children() -> set[int]:
    pids: set[int] = set()
    for task in Path("/proc/self/task").iterdir():
        try:
            pids.update(map(int, (task / "children").read_text().split()))
        except OSError:  # that thread has just ended
            continue
    return pids - warm_start.pids()


def _command_of(pid: int) -> str:
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
    except OSError:
        words = []
    return f"{pid}: {b' '.join(words).decode() or 'ended, nobody waited for it'}"


def _left_after_grace(left: Callable[[], set[object]]) -> set[object]:
    until_s = time.monotonic() + GRACE_S
    while (remaining := left()) and time.monotonic() < until_s:
        time.sleep(0.01)
    return remaining


@pytest.fixture(autouse=True)
def no_thread_or_process_is_left() -> Iterator[None]:
    threads, children = set(threading.enumerate()), _children()
    yield
    # Dask keeps one loop for all its clients, to the end of the process.
    left = _left_after_grace(
        lambda: {
            thread
            for thread in set(threading.enumerate()) - threads
            if thread.name != "IO loop"
        }
    )
    assert not left, f"the test left threads behind: {left}"
    # Python starts one helper for all pools of processes, and keeps it to its end.
    left = _left_after_grace(
        lambda: {
            pid
            for pid in _children() - children
            if "multiprocessing.resource_tracker" not in _command_of(pid)
        }
    )
    commands = [_command_of(pid) for pid in left if isinstance(pid, int)]
    assert not left, f"the test left processes behind: {commands}"


@contextlib.asynccontextmanager
async def no_task_stays() -> AsyncIterator[None]:
    """Fail where the block leaves a task behind."""
    before = asyncio.all_tasks()
    yield
    left = asyncio.all_tasks() - before - {asyncio.current_task()}
    assert not left, f"the test left tasks behind: {left}"


@pytest.fixture
async def _no_task() -> AsyncIterator[None]:
    async with no_task_stays():
        yield


@pytest.fixture(autouse=True)
def no_task_is_left(
    request: pytest.FixtureRequest, no_thread_or_process_is_left: None
) -> None:
    function = getattr(request, "function", None)
    if inspect.iscoroutinefunction(function):
        request.getfixturevalue("_no_task")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(
    config: pytest.Config, log: Any
) -> LoadFileScheduling | None:
    """Give each worker a file at a time; one gets all tests with the browser."""
    if config.getoption("dist") != "loadfile":
        return None
    return FileScheduling(config, log)


class FileScheduling(LoadFileScheduling):
    """A worker's next tests: of a file, or of the folder `browser`.

    Of files that wait, one test: else a worker waits for all of them, when the others
    have long ended.
    """

    def _split_scope(self, nodeid: str) -> str:
        if nodeid.partition("::")[0].endswith(WAITING):
            return nodeid
        before, browser, _ = nodeid.partition("/browser/")
        return before if browser else super()._split_scope(nodeid)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Spread the files of every folder: those that wait among those that compute.

    Workers take file by file in this order, so that cores are busy until the end. What
    takes longest is not last.
    """
    for item in items:
        for group in _needed(item) - programs.groups().keys():
            raise pytest.UsageError(
                f"{item.nodeid} needs group {group!r}, which {programs.INSTALLER} "
                "does not know: add it there, with its programs and packages"
            )
    folders: dict[str, dict[Path, None]] = {}
    for item in items:
        parts = Path(os.path.relpath(item.path, Path(__file__).parent)).parts
        folder = "/".join(parts[:2])
        folder = folder if folder in LONG else parts[0]
        folders.setdefault(folder, {})[item.path] = None
    ranks = {
        path: position / len(files) * (0.6 if folder in LONG else 1.0)
        for folder, files in folders.items()
        for position, path in enumerate(files)
    }
    items.sort(key=lambda item: (ranks[item.path], item.path))
    gc.freeze()  # what was imported and collected is not looked through again
    gc.set_threshold(20_000, 20, 20)  # results of tests are small, and live briefly
    gc.enable()


def pytest_sessionfinish() -> None:
    """End the processes that programs were forked from."""
    warm_start.close()


@pytest.fixture(scope="session")
def mosquitto(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mosquitto]:
    """A broker for all tests that do not disturb it; mark them `needs("mosquitto")`."""
    broker = Mosquitto(tmp_path_factory.mktemp("mosquitto"))
    broker.start()
    yield broker
    broker.stop()


@pytest.fixture
def make_mosquitto(tmp_path: Path) -> Iterator[Callable[..., Mosquitto]]:
    """Makes brokers that a test may stop, kill and start again as it likes."""
    made: list[Mosquitto] = []

    def make(passwords: dict[str, str] | None = None, **options: Any) -> Mosquitto:
        broker = Mosquitto(tmp_path, passwords, **options)
        made.append(broker)
        broker.start()
        return broker

    yield make
    for broker in made:
        broker.stop()
