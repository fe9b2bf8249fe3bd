import asyncio
import re
import signal
from pathlib import Path

import pytest

from tests.end_to_end.programs import Program
from tests.mosquitto import HOST, Mosquitto, free_port
from traverse.testing.waiting import until


def assert_nothing_is_left(folder: Path) -> None:
    """No program of a demonstration in this folder runs, no file of it is there."""
    running = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            command = (process / "cmdline").read_bytes().decode()
        except OSError:  # has just ended
            continue
        if str(folder) in command:
            running.append(command.replace("\0", " "))
    assert running == []
    assert list(folder.glob("traverse-demo-*")) == []


async def measure_one_round(folder: Path, broker: Mosquitto) -> None:
    where = ("--broker", f"{broker.host}:{broker.port}")
    with Program(folder, "once", "demo", "--once", *where) as demo:
        assert await demo.ended(90.0) == 0
        match = re.search(
            r"bar +ball bar: length (\d+\.\d{4}) mm, certificate 800\.0000 mm, "
            r"deviation ([+-]\d+\.\d{4}) mm",
            demo.output,
        )
        assert match, demo.output
        length_mm, deviation_mm = map(float, match.groups())
        assert length_mm - 800.0 == pytest.approx(deviation_mm, abs=1e-9)
        assert abs(deviation_mm) < 0.2
        for expected in ("ball  ", "seat  ", "latency", "Hz achieved", " 0 missing"):
            assert expected in demo.output
        assert len(re.findall(r" point +\d", demo.output)) == 36
        assert demo.log == ""


async def measure_some_seconds(folder: Path) -> None:
    with Program(folder, "seconds", "demo", "--for", "10", "--no-page") as demo:
        assert await demo.ended(45.0) == 0
        assert " point     0" in demo.output
        assert "measured 0 rounds" in demo.output
        assert demo.log == ""


async def measure_until(folder: Path, number: signal.Signals) -> None:
    """A closed terminal ends it with a summary, as Ctrl-C and `kill` do."""
    with Program(folder, number.name, "demo", "--rate", "250") as demo:
        await until(lambda: demo.output.count("point     2") > 0, "three points", 30.0)
        assert await demo.stop(number) == 0
        assert "measured 0 rounds" in demo.output
        assert "latency" in demo.output
        achieved = re.search(r"([\d.]+) Hz achieved", demo.output)
        assert achieved, demo.output
        assert float(achieved[1]) == pytest.approx(250.0, rel=0.02)
        assert "Traceback" not in demo.log


@pytest.mark.slow
@pytest.mark.needs("mosquitto")
async def test_three_demonstrations_beside_each_other(
    mosquitto: Mosquitto, tmp_path: Path
) -> None:
    async with asyncio.TaskGroup() as tasks:
        tasks.create_task(measure_one_round(tmp_path, mosquitto))
        tasks.create_task(measure_some_seconds(tmp_path))
        tasks.create_task(measure_until(tmp_path, signal.SIGHUP))
    assert_nothing_is_left(tmp_path)


@pytest.mark.slow
async def test_a_broker_that_is_not_there_is_told(tmp_path: Path) -> None:
    where = ("--broker", f"{HOST}:{free_port()}")
    with Program(tmp_path, "demo", "demo", *where) as demo:
        assert await demo.ended(30.0) == 3
        assert "nothing listens there" in demo.log
        assert "Traceback" not in demo.log
    assert_nothing_is_left(tmp_path)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
async def test_it_ends_before_anything_runs_too(tmp_path: Path, number: int) -> None:
    with Program(tmp_path, "demo", "demo") as demo:
        await until(lambda: list(tmp_path.glob("traverse-demo-*/*.log")), "it begins")
        assert await demo.stop(number) in {0, 130}
        assert "Traceback" not in demo.log
    assert_nothing_is_left(tmp_path)
