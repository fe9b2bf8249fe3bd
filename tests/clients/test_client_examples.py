"""The examples of the client run, and the pages show them as they are."""

import asyncio
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from tests.clients.reading import PATIENCE_S, until
from tests.clients.virtual_daemon import VirtualDaemon

CHECKOUT = Path(__file__).parent.parent.parent
EXAMPLES = CHECKOUT / "examples"
PAGES = {
    "notebook": "points-in-a-notebook.md",
    "follow": "read-points-from-your-software.md",
    "store": "read-points-from-your-software.md",
}


class Example:
    """An example as a program of its own, its output in a file."""

    def __init__(self, folder: Path, name: str, *arguments: str) -> None:
        self._out = folder / f"{name}.out"
        with self._out.open("wb") as out:
            self.process = subprocess.Popen(
                [sys.executable, str(EXAMPLES / f"{name}.py"), *arguments],
                stdout=out,
                stderr=out,
                env={"PYTHONPATH": str(CHECKOUT), "OPENBLAS_NUM_THREADS": "1"},
            )

    @property
    def output(self) -> str:
        return self._out.read_text()

    async def stop(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        await asyncio.to_thread(self.process.wait, PATIENCE_S)


@pytest.mark.parametrize("name", PAGES)
def test_pages_show_the_examples_that_are_run(name: str) -> None:
    page = (CHECKOUT / "docs" / "how-to" / PAGES[name]).read_text("utf-8")
    assert (EXAMPLES / f"{name}.py").read_text("utf-8").rstrip() in page
    assert {path.stem for path in EXAMPLES.glob("*.py")} == set(PAGES)


@pytest.mark.broker
async def test_notebook_takes_points_and_looks_at_them(
    virtual: VirtualDaemon, broker: str, tmp_path: Path
) -> None:
    async with virtual.running():
        example = Example(tmp_path, "notebook", virtual.arm, broker)
        await until(lambda: example.process.poll() is not None)
        assert example.process.returncode == 0, example.output
        lines = example.output.splitlines()
        assert lines[0].startswith("mean [")
        assert [line.split()[0] for line in lines[1:]] == ["0", "1", "2"]


@pytest.mark.broker
async def test_follow_goes_on_where_it_stopped(
    virtual: VirtualDaemon, broker: str, tmp_path: Path
) -> None:
    place = tmp_path / "place.json"
    place.write_text(
        f'{{"schema": "traverse/place/1", "arm": "{virtual.arm}", "sessions": {{}}}}'
    )
    async with virtual.running():
        await virtual.take(3)
        example = Example(tmp_path, "follow", virtual.arm, broker, str(place))
        await until(lambda: len(example.output.splitlines()) == 3)
        await until(lambda: f'"{virtual.session}": 2' in place.read_text())
        await example.stop()
        await virtual.take(1)
        example = Example(tmp_path, "follow", virtual.arm, broker, str(place))
        await until(lambda: len(example.output.splitlines()) == 2)
        await example.stop()
        seqs = [line.split()[0] for line in example.output.splitlines()]
        assert seqs == ["2", "3"]  # the one in hand comes again


@pytest.mark.broker
async def test_store_has_every_point_once_after_being_killed(
    virtual: VirtualDaemon, broker: str, tmp_path: Path
) -> None:
    path = tmp_path / "store.db"

    def stored() -> list[int]:
        with sqlite3.connect(path) as database:
            try:
                rows = database.execute("SELECT seq FROM points ORDER BY rowid")
                return [seq for (seq,) in rows]
            except sqlite3.OperationalError:
                return []
        return []

    async with virtual.running():
        for n in (3, 6):
            await virtual.take(3)
            example = Example(tmp_path, "store", virtual.arm, broker, str(path))
            await until(lambda n=n: stored() == list(range(n)))
            await example.stop()
