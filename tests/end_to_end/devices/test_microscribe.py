"""From the cable of a MicroScribe to points, with the two commands of its owner."""

import math
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.end_to_end.agreement import (
    assert_where_the_ball_was,
    delays_s,
    is_marked_for_time,
)
from tests.end_to_end.arm_matrices import MatrixArm
from tests.end_to_end.listener import Listener, listening
from tests.end_to_end.programs import Program
from tests.end_to_end.workbench import Workbench
from tests.established import identify
from tests.mosquitto import Mosquitto
from tests.running import invoke

pytestmark = pytest.mark.needs("mosquitto")

ALPHA = (0, 16384, 0, -16384, 16384, -16384)
A = (0, 750, 10250, 750, 0, 0)
D = (8250, 0, 0, 9000, 0, 5750)
SPHERE = """\
[[motion]]
kind = "rest"
duration_s = {rest_s}

[[motion]]
kind = "sphere"
artefact = "ball"
centre_mm = [300.0, 100.0, 120.0]
radius_mm = 25.4
points = 2
"""
FAULTS = """\
[[fault]]
kind = "cut"
probability = 0.02

[[fault]]
kind = "late"
probability = 0.005
delay_s = 0.15

[[fault]]
kind = "reset"
at_s = 0.8
duration_s = 0.2
"""


def write_true_arm(folder: Path) -> None:
    """The arm behind the simulated MicroScribe, by `traverse arm from-dh`."""
    rows = ["alpha_rad,a_mm,d_mm"]
    for alpha, a, d in zip(ALPHA, A, D, strict=True):
        rows.append(f"{alpha * math.pi / 32768!r},{a * 0.0254!r},{d * 0.0254!r}")
    table = folder / "dh.csv"
    table.write_text("\n".join(rows), "utf-8")
    words = f"arm from-dh {table} --out {folder / 'true.toml'} --device microscribe "
    words += "--convention modified --counts-per-turn 8000 "
    words += "--base-posture-rad 0.1,0.2,0,0,0.3,0"
    invoke(*words.split())


def simulator_text(faults: str, device: str) -> str:
    sphere = SPHERE.format(rest_s=1.5 if faults else 0.5)
    return f"""\
schema = "traverse/simulator/1"
start = "first_start"
truth_log = "truth.jsonl"
repeat = true
[arm]
file = "true.toml"
[operator]
move_s = 0.7
approach_s = 0.1
dwell_s = 0.1
press_s = 0.25
[[device]]
kind = "microscribe"
id = "microscribe"
port = "arm.pty"
first_ticks = 15000
home = [300, 7900, 40, 0, 10, 0]
{device}
[device.geometry]
alpha = {list(ALPHA)}
a = {list(A)}
d = {list(D)}
{sphere}
{faults}
"""


async def measured(
    bench: Workbench,
    faults: str = "",
    device: str = "",
    option: str = "",
    state: str | None = "ready",
) -> Listener:
    """Two points of the simulated arm, by the files that `arm-file` wrote."""
    folder = bench.folder
    bench.arm_file.unlink()
    write_true_arm(folder)
    (folder / "simulator.toml").write_text(simulator_text(faults, device), "utf-8")
    async with listening(bench.host, bench.port, bench.arm) as listener:
        with bench.simulator() as simulator:
            await simulator.says("ready microscribe")
            words = f"--port arm.pty --out arm.toml --name {bench.arm}"
            with Program(folder, "ask", "microscribe", "arm-file", *words.split()) as a:
                assert await a.ended() == 0
            identify(bench.arm_file)
            written = folder / "traverse.toml"
            text = written.read_text("utf-8").replace(
                'host = "localhost"', f'host = "{bench.host}"\nport = {bench.port}'
            )
            text = text.replace("baud_rate", f"{option}\nbaud_rate")
            written.write_text(text, "utf-8")
            with Program(folder, "daemon", "run", "traverse.toml") as d:
                # Only its owner can confirm that it was in its home position.
                await listener.ready(state)
                await listener.event("device.turns_uncertain", active=True)
                await listener.n_points(2)
                assert await d.stop() == 0
            assert await simulator.stop() == 0
    return listener


def truth_of(bench: Workbench, listener: Listener) -> list[dict[str, Any]]:
    """The edges behind the points; a bad line may have cost others.

    The script repeats: of the edges with the counts of a point, those whose times fit.
    """
    presses = bench.presses()
    alike = [
        [edge for edge in presses if edge["counts"] == [c % 8000 for c in point.counts]]
        for point in listener.points
    ]
    assert all(alike)
    series = map(list, product(*alike))
    return min(series, key=lambda edges: np.ptp(delays_s(listener.points, edges)))


def assert_true(bench: Workbench, listener: Listener, held_back_s: float = 0.0) -> None:
    """Points are where the ball was when the packet was latched.

    Args:
        bench: Of the run.
        listener: Of its messages.
        held_back_s: How long the line may keep back the packet that shows a press.
    """
    presses = truth_of(bench, listener)
    assert [point.seq for point in listener.points] == list(range(len(presses)))
    assert {point.trigger for point in listener.points} == {"button"}
    flags = {flag for point in listener.points for flag in point.quality.flags}
    # An arm that was off meanwhile is in doubt again, and so are counts near bytes that
    # were spoilt. On a busy machine packets may be read too late to know their times.
    in_doubt = {"time_uncertain"}
    in_doubt |= {"turns_uncertain"} if listener.events_of("device.restarted") else set()
    in_doubt |= (
        {"encoder_warning"} if listener.events_of("device.frames_rejected") else set()
    )
    assert flags - {"interpolated"} <= in_doubt
    certain = [not is_marked_for_time(point) for point in listener.points]
    delays = delays_s(listener.points, presses)[certain]
    # A press is in the next packet, of which there are 100 a second.
    assert np.ptp(delays) < held_back_s + 2e-2, delays
    assert MatrixArm(bench.arm_file).resolution_mm() < 5.0
    assert_where_the_ball_was(bench, listener.points, presses)
    for point, edge in zip(listener.points, presses, strict=True):
        assert np.abs(np.array(point.ijk) - edge["shank"]).max() < 5e-3


@pytest.mark.slow
async def test_reports_of_motion_bring_points_with_the_counts_of_their_packets(
    bench: Workbench,
) -> None:
    listener = await measured(bench, device="hci = 3", option='report = "motion"')
    assert_true(bench, listener)
    arm = MatrixArm(bench.arm_file)
    for point, edge in zip(listener.points, truth_of(bench, listener), strict=True):
        centre_mm, _ = arm.pose(edge["counts"])
        assert np.abs(np.array(point.xyz_mm) - centre_mm).max() < 1e-6
    assert not listener.events_of("device.timer_unused")


@pytest.mark.slow
async def test_a_bad_line_costs_samples_and_invents_nothing(bench: Workbench) -> None:
    # Spoilt bytes leave the readings in doubt for seconds, again and again.
    listener = await measured(bench, FAULTS, state=None)
    # The next packet is requested after a late one arrived (0.15 s), or after the time
    # limit of one that was cut: a press in the meantime is in that next one.
    assert_true(bench, listener, held_back_s=0.2)
    assert listener.events_of("device.samples_lost")
    assert listener.events_of("device.restarted")


async def test_a_port_without_an_arm_is_reported(tmp_path: Path, mosquitto: Mosquitto):
    del mosquitto
    words = "--port nothing.pty --out arm.toml"
    with Program(tmp_path, "ask", "microscribe", "arm-file", *words.split()) as program:
        assert await program.ended() == 3
        assert "nothing.pty" in program.log
    assert not (tmp_path / "arm.toml").exists()
