"""The examples of the client run, and the pages show them as they are, or link them."""

import runpy
import sqlite3
import subprocess
import sys
from contextlib import AbstractContextManager, closing
from functools import partial
from pathlib import Path

import pytest

from tests.client.reading import PATIENCE_S
from tests.client.virtual_daemon import VirtualDaemon
from tests.protocol.message_examples import POINT
from tests.running import run_program
from traverse.protocol.messages import Label
from traverse.protocol.messages.quality import Quality
from traverse.testing.waiting import until

CHECKOUT = Path(__file__).parent.parent.parent
EXAMPLES = CHECKOUT / "examples"
PAGES = {
    "circle": "tutorial/circle-over-ippdme.md",
    "notebook": "how-to/read-points-in-your-program.md",
    "follow": "how-to/read-points-in-your-program.md",
    "store": "how-to/read-points-in-your-program.md",
}
LINKED = {"circle", "store"}  # too long to be read in a page
MACROS = {"blender_points": 1e-3, "freecad_points": 1.0}
"""Scripts that run in other programs, and their unit of length in a millimetre."""


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
def test_pages_show_or_link_the_examples_that_are_run(name: str) -> None:
    page = (CHECKOUT / "docs" / PAGES[name]).read_text("utf-8")
    shown = (EXAMPLES / f"{name}.py").read_text("utf-8").rstrip() in page
    assert shown == (name not in LINKED)
    assert shown or f"](../../examples/{name}.py)" in page
    assert {path.stem for path in EXAMPLES.iterdir() if path.is_file()} == {
        *PAGES,
        *MACROS,
    }


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
    arguments = (virtual.arm, broker, str(place))
    async with virtual.running():
        await virtual.take(3)
        with Example(tmp_path, "follow", *arguments) as example:
            await until(lambda: len(example.output.splitlines()) == 3)
            await until(lambda: f'"{virtual.session}": 3' in place.read_text())
        await virtual.take(1)
        with Example(tmp_path, "follow", *arguments) as example:
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


def macro(name: str) -> Path:
    (path,) = EXAMPLES.glob(f"{name}.*")
    return path


@pytest.mark.parametrize("name", MACROS)
def test_a_macro_without_its_program_says_where_to_run_it(name: str) -> None:
    words = [sys.executable, macro(name)]
    ran = run_program(*words, status=1)
    assert ran.stderr.startswith(macro(name).name)
    assert ran.stderr.count("\n") == 1


@pytest.mark.parametrize(("name", "unit"), MACROS.items())
def test_a_macro_groups_points_that_were_not_taken_back(name: str, unit: float) -> None:
    changes_of = {
        "a": {"label": Label(artefact="plate", feature="7")},
        "b": {"label": Label(artefact="plate", feature="7")},
        "c": {},
        "d": {"quality": POINT.quality},
        "undo": {"retracts": "b"},
    }
    good = {"quality": Quality.from_bits(0), "label": Label()}
    standing = runpy.run_path(str(macro(name)))["Standing"]()
    for number, (point_id, changes) in enumerate(changes_of.items()):
        place = {"id": point_id, "xyz_mm": (1000.0 * number, -20.0, 0.5)}
        standing.take(POINT.model_copy(update=good | place | changes))
    assert standing.groups() == {
        "plate 7": [pytest.approx((0.0, -20.0 * unit, 0.5 * unit))],
        "points": [pytest.approx((2000.0 * unit, -20.0 * unit, 0.5 * unit))],
        "in doubt": [pytest.approx((3000.0 * unit, -20.0 * unit, 0.5 * unit))],
    }


@pytest.mark.parametrize("name", MACROS)
def test_a_macro_counts_points_without_the_chosen_coordinates(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TRAVERSE_COORDINATES", "part_xyz_mm")
    standing = runpy.run_path(str(macro(name)))["Standing"]()
    standing.take(POINT.model_copy(update={"part_xyz_mm": None}))
    assert (standing.groups(), standing.left_out) == ({}, 1)


def has_stored(path: Path, n: int) -> bool:
    with closing(sqlite3.connect(path)) as database:
        try:
            rows = database.execute("SELECT seq FROM points ORDER BY rowid").fetchall()
        except sqlite3.OperationalError:
            return False  # it has no tables yet
    return rows == [(seq,) for seq in range(n)]
