"""What all tests share: nothing survives a test, and a real broker."""

import asyncio
import gc
import inspect
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests import warm_start
from tests.mosquitto import Mosquitto, find_mosquitto

GRACE_S = 2.0


def _children() -> set[int]:
    found = set()
    for task in Path("/proc/self/task").iterdir():
        try:
            found.update(map(int, (task / "children").read_text().split()))
        except OSError:  # that thread has just ended
            continue
    return found - warm_start.pids()


def _command_of(pid: int) -> str:
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
    except OSError:
        words = []
    return f"{pid}: {b' '.join(words).decode() or 'ended, nobody waited for it'}"


def _left_after_grace(left: Callable[[], set[object]]) -> set[object]:
    until_s = time.monotonic() + GRACE_S
    while (found := left()) and time.monotonic() < until_s:
        time.sleep(0.01)
    return found


@pytest.fixture(autouse=True)
def no_thread_or_process_is_left() -> Iterator[None]:
    threads, children = set(threading.enumerate()), _children()
    yield
    left = _left_after_grace(lambda: {*set(threading.enumerate()) - threads})
    assert not left, f"the test left threads behind: {left}"
    left = _left_after_grace(lambda: {*_children() - children})
    commands = [_command_of(pid) for pid in left if isinstance(pid, int)]
    assert not left, f"the test left processes behind: {commands}"


@pytest.fixture
async def _no_task() -> AsyncIterator[None]:
    before = asyncio.all_tasks()
    yield
    left = asyncio.all_tasks() - before - {asyncio.current_task()}
    assert not left, f"the test left tasks behind: {left}"


@pytest.fixture(autouse=True)
def no_task_is_left(
    request: pytest.FixtureRequest, no_thread_or_process_is_left: None
) -> None:
    function = getattr(request, "function", None)
    if inspect.iscoroutinefunction(function):
        request.getfixturevalue("_no_task")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Spread the files of every folder: those that wait among those that compute.

    Workers take file by file in this order, so that cores are busy until the end.
    """
    folders: dict[str, dict[Path, None]] = {}
    for item in items:
        folder = item.path.relative_to(Path(__file__).parent).parts[0]
        folders.setdefault(folder, {})[item.path] = None
    ranks = {
        path: at / len(files)
        for files in folders.values()
        for at, path in enumerate(files)
    }
    items.sort(key=lambda item: (ranks[item.path], item.path))
    gc.collect()
    gc.freeze()  # what was imported and collected is not looked through again


def pytest_sessionfinish() -> None:
    """End what programs were forked from."""
    warm_start.close_all()


@pytest.fixture(scope="session")
def mosquitto_program() -> str:
    """Path of mosquitto; the test is skipped where there is none."""
    program = find_mosquitto()
    if program is None:
        pytest.skip("needs a mosquitto on this machine")
    return program


@pytest.fixture(scope="session")
def mosquitto(
    mosquitto_program: str, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Mosquitto]:
    """A broker for all tests that do not disturb it; mark them `broker`."""
    broker = Mosquitto(mosquitto_program, tmp_path_factory.mktemp("mosquitto"))
    broker.start()
    yield broker
    broker.stop()


@pytest.fixture
def make_mosquitto(
    mosquitto_program: str, tmp_path: Path
) -> Iterator[Callable[..., Mosquitto]]:
    """Makes brokers that a test may stop, kill and start again as it likes."""
    made: list[Mosquitto] = []

    def make(passwords: dict[str, str] | None = None, **options: Any) -> Mosquitto:
        broker = Mosquitto(mosquitto_program, tmp_path, passwords, **options)
        made.append(broker)
        broker.start()
        return broker

    yield make
    for broker in made:
        broker.stop()
