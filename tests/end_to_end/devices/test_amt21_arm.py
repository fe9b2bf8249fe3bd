"""Seven AMT21 encoders on one line, the button on a board of its own, and a pedal."""

import os
import struct
import time

import numpy as np
import pytest

from tests.end_to_end.agreement import assert_where_the_ball_was
from tests.end_to_end.listener import Listener
from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import REST, SPHERE, Workbench, rest
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")

ENCODERS = """\
kind = "amt21"
addresses = [0x54, 0x58, 0x5C, 0x60, 0x64, 0x68, 0x6C]
baud_rate = 2000000
request_delay_s = 0.0001
reply_delay_s = 0.0001
echo = true
[[device]]
id = "handle"
port = "handle.pty"
inputs = ["button"]
"""
READ_BY = """\
driver = "amt21"
port = "{pty}"
addresses = [0x54, 0x58, 0x5C, 0x60, 0x64, 0x68, 0x6C]
answer_timeout_s = 0.1
max_speed_rad_s = 500.0
"""
HANDLE = """
[[device]]
id = "handle"
driver = "latch-board"
port = "{folder}/handle.pty"
[[device]]
id = "pedal"
driver = "evdev"
port = "{folder}/pedal"
keys = ["KEY_B"]
"""
PEDAL = '{ source = "pedal/0", trigger = "button" }'
SILENT = """
[[fault]]
kind = "silent"
device = "base"
channel = 2
at_s = 6.0
duration_s = 1.0
"""


@pytest.fixture
def line(bench: Workbench) -> Workbench:
    bench.change("arm.toml", "8388608", "16384")
    bench.change("arm.toml", "4194304", "16384")
    bench.write_daemon(
        capture="tracking_rate_hz = 20.0",
        read_by=READ_BY.format(pty=bench.pty),
        source="handle",
        devices=HANDLE.format(folder=bench.folder),
    )
    bench.change("daemon.toml", "inputs = [", f"inputs = [{PEDAL}, ")
    os.mkfifo(bench.folder / "pedal")
    return bench


def step_on(pedal: int) -> None:
    now_ns = time.monotonic_ns()
    stamp = (now_ns // 10**9, now_ns % 10**9 // 1000)
    for value in (1, 0):
        os.write(pedal, struct.pack("@llHHi", *stamp, 1, 48, value))
        os.write(pedal, struct.pack("@llHHi", *stamp, 0, 0, 0))


@pytest.mark.slow
async def test_points_of_amt21_encoders_are_where_the_ball_was(line: Workbench) -> None:
    motions = (rest(3.0), SPHERE.format(points=4), REST)
    line.write_simulator(*motions, board=ENCODERS, faults=SILENT)
    # At rest for several samples, which a busy machine reads at a low rate only.
    line.change("simulator.toml", "dwell_s = 0.06", "dwell_s = 0.3")
    # A pipe replaces the pedal's device file; the writer holds it open.
    pedal = os.open(line.folder / "pedal", os.O_RDWR)
    # On a busy machine answers are late again and again: its numbers stay in doubt.
    async with measuring(line, state=None) as (listener, _, _):
        await until(lambda: n_settled(listener) >= 4, "4 points or refusals")

        def alarms_of_encoder_2() -> list[bool | None]:
            return [
                event.active
                for event in listener.events
                if event.code == "alarm.encoder_missing" and "0x5c" in event.text
            ]

        await until(lambda: alarms_of_encoder_2()[-1:] == [False], "it is back")
        assert alarms_of_encoder_2()[0]
        n_probed = len(listener.points)
        step_on(pedal)
        await until(lambda: n_settled(listener) >= 5, "a point or refusal by the pedal")
        health = listener.healths[-1]
    os.close(pedal)
    points = listener.points
    truth_mm = np.array([edge["centre_mm"] for edge in line.presses()])
    probed = points[:n_probed]
    assert probed
    # Which of the presses each of them is of, where others were refused.
    truth = [
        line.presses()[np.abs(truth_mm - point.xyz_mm).max(axis=1).argmin()]
        for point in probed
    ]
    assert_where_the_ball_was(line, probed, truth, by_several_clocks=True)
    assert {point.trigger for point in points} == {"button"}
    assert all("interpolated" in point.quality.flags for point in points)
    assert health.skew_mm is not None
    counters = next(d.counters for d in health.devices if d.id == "base")
    assert counters["echoed"] == 1
    assert counters["missed_2"] >= 3
    codes = {event.code for event in listener.events}
    assert "device.times_estimated" in codes  # a pipe has no clock of its own


def n_settled(listener: Listener) -> int:
    """Presses that have become a point or a refusal."""
    return len(listener.points) + len(listener.events_of("capture.refused"))
