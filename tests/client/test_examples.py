"""The examples of the client run, and the pages show them as they are."""

import sqlite3
import subprocess
import sys
from contextlib import AbstractContextManager, closing
from functools import partial
from pathlib import Path

import pytest

from tests.client.reading import PATIENCE_S, until
from tests.client.virtual_daemon import VirtualDaemon

CHECKOUT = Path(__file__).parent.parent.parent
EXAMPLES = CHECKOUT / "examples"
PAGES = {
    "circle": "tutorial/circle-over-ippdme.md",
    "notebook": "how-to/read-points-in-your-program.md",
    "follow": "how-to/read-points-in-your-program.md",
    "store": "how-to/read-points-in-your-program.md",
}


class Example(AbstractContextManager["Example"]):
    """An example as a program of its own, its output in a file; killed at the end."""

    def __init__(self, folder: Path, name: str, *arguments: str) -> None:
        self._out = folder / f"{name}.out"
        with self._out.open("wb") as out:
            self.process = subprocess.Popen(
                [sys.executable, str(EXAMPLES / f"{name}.py"), *arguments],
                stdout=out,
                stderr=out,
                env={"OPENBLAS_NUM_THREADS": "1"},
            )

    @property
    def output(self) -> str:
        return self._out.read_text()

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self.process.kill()
        self.process.wait(PATIENCE_S)
        if kind is not None:  # pytest shows it with the failure
            print(self.output)  # noqa: T201


@pytest.mark.parametrize("name", PAGES)
def test_pages_show_the_examples_that_are_run(name: str) -> None:
    page = (CHECKOUT / "docs" / PAGES[name]).read_text("utf-8")
    assert (EXAMPLES / f"{name}.py").read_text("utf-8").rstrip() in page
    assert {path.stem for path in EXAMPLES.glob("*.py")} == set(PAGES)


@pytest.mark.needs("mosquitto")
async def test_notebook_takes_points_and_looks_at_them(
    virtual: VirtualDaemon, broker: str, tmp_path: Path
) -> None:
    async with virtual.running():
        with Example(tmp_path, "notebook", virtual.arm, broker) as example:
            await until(lambda: example.process.poll() is not None)
        assert example.process.returncode == 0, example.output
        lines = example.output.splitlines()
        assert lines[0].startswith("mean [")
        assert [line.split()[0] for line in lines[1:]] == ["0", "1", "2"]


@pytest.mark.needs("mosquitto")
async def test_follow_continues_where_it_stopped(
    virtual: VirtualDaemon, broker: str, tmp_path: Path
) -> None:
    place = tmp_path / "place.json"
    place.write_text(
        f'{{"schema": "traverse/place/1", "arm": "{virtual.arm}", "sessions": {{}}}}'
    )
    what = (virtual.arm, broker, str(place))
    async with virtual.running():
        await virtual.take(3)
        with Example(tmp_path, "follow", *what) as example:
            await until(lambda: len(example.output.splitlines()) == 3)
            await until(lambda: f'"{virtual.session}": 3' in place.read_text())
        await virtual.take(1)
        with Example(tmp_path, "follow", *what) as example:
            await until(lambda: example.output != "")
        assert [line.split()[0] for line in example.output.splitlines()] == ["3"]


@pytest.mark.needs("mosquitto")
async def test_store_has_every_point_once_after_being_killed(
    virtual: VirtualDaemon, broker: str, tmp_path: Path
) -> None:
    path = tmp_path / "store.db"
    async with virtual.running():
        for n in (3, 6):
            await virtual.take(3)
            with Example(tmp_path, "store", virtual.arm, broker, str(path)):
                await until(partial(has_stored, path, n))


def has_stored(path: Path, n: int) -> bool:
    """Whether the first n points are there, in order."""
    with closing(sqlite3.connect(path)) as database:
        try:
            rows = database.execute("SELECT seq FROM points ORDER BY rowid").fetchall()
        except sqlite3.OperationalError:
            return False  # it has no tables yet
    return rows == [(seq,) for seq in range(n)]
