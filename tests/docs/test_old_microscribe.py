import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from tests.docs.pages import text_of
from tests.end_to_end.programs import Program
from tests.established import believe_utc
from tests.mosquitto import free_port
from traverse.testing.waiting import until

PAGE = "docs/tutorial/old-microscribe.md"
_BLOCK = re.compile(r"^```(?P<language>\w+)\n(?P<text>.*?)^```$", re.DOTALL | re.M)
CENTRE_MM, RADIUS_MM = (300.0, 100.0, 120.0), 25.4


def blocks(language: str) -> list[str]:
    matches = _BLOCK.finditer(text_of(PAGE))
    return [match["text"] for match in matches if match["language"] == language]


def shown_commands() -> list[tuple[list[str], list[str]]]:
    """Words of each command behind `traverse`, and the lines shown below it."""
    shown = []
    for block in blocks("console"):
        command, *lines = block.splitlines()
        _, _, words = command.partition("$ traverse ")
        shown.append((shlex.split(words), lines))
    return shown


@pytest.mark.slow
async def test_the_two_commands_bring_points_on_the_ball(tmp_path: Path):
    (table,), (simulator,) = blocks("csv"), blocks("toml")
    believe_utc(tmp_path)
    (tmp_path / "table.csv").write_text(table, "utf-8")
    (tmp_path / "simulator.toml").write_text(simulator, "utf-8")
    port = str(free_port())
    from_dh, simulate, arm_file, run, confirm, watch = shown_commands()

    async def does(name: str, words: list[str], lines: list[str]) -> None:
        with Program(tmp_path, name, *words) as program:
            assert await program.ended() == 0
            assert program.output.splitlines() == lines

    await does("from-dh", *from_dh)
    with Program(tmp_path, "simulate", *simulate[0]) as simulated:
        await simulated.says(simulate[1][0])
        await does("arm-file", *arm_file)
        # The broker's usual port may be taken where tests run.
        with Program(tmp_path, "run", *run[0], "--embedded-port", port) as daemon:
            await daemon.says("model")
            where = ["--broker", f"localhost:{port}"]
            await does("confirm", [*confirm[0], *where], confirm[1])
            words = [*watch[0], *where]
            with Program(tmp_path, "watch", *words) as watching:
                await until(lambda: len(points(watching.output)) >= 3, "3 points")
            measured_mm = points(watching.output)
            # Confirmed, one flag is left, as on the page: nobody has identified it.
            lines = [*watching.output.splitlines()[:3], *watch[1]]
            assert {line.partition(" mm")[2] for line in lines} == {
                "  geometry_unknown"
            }
            assert await daemon.stop() == 0
        assert await simulated.stop() == 0
    distances_mm = np.linalg.norm(measured_mm - np.array(CENTRE_MM), axis=1)
    assert np.abs(distances_mm - RADIUS_MM).max() < 1.2
    for line in watch[1]:
        assert points(line + "\n").shape == (1, 3)
    told_mm = points("\n".join(watch[1]) + "\n")
    assert np.abs(np.linalg.norm(told_mm - CENTRE_MM, axis=1) - RADIUS_MM).max() < 1.2


def points(output: str) -> np.ndarray:
    lines = [line for line in output.splitlines(keepends=True) if line[-1] == "\n"]
    matches = [re.search(r" point +\d+((?: +-?[\d.]+){3}) mm", line) for line in lines]
    return np.array([match[1].split() for match in matches if match], dtype=float)
