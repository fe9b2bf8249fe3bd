"""Seven CANopen encoders behind an slcan adapter, the button on a board of its own."""

import pytest

from tests.end_to_end.agreement import assert_where_the_ball_was
from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import SPHERE, Workbench, rest
from traverse.protocol.messages import PointArgs

pytestmark = pytest.mark.needs("mosquitto")

ENCODERS = """\
kind = "canopen"
interface = "slcan"
nodes = [11, 12, 13, 14, 15, 16, 17]
encoder_turns = 64
[[device]]
id = "handle"
port = "handle.pty"
inputs = ["button"]
"""
READ_BY = """\
driver = "canopen"
interface = "slcan"
channel = "{pty}"
nodes = [11, 12, 13, 14, 15, 16, 17]
heartbeat_ms = 500
"""
HANDLE = """
[[device]]
id = "handle"
driver = "latch-board"
port = "{folder}/handle.pty"
"""


def write_daemon(bench: Workbench) -> None:
    bench.write_daemon(
        read_by=READ_BY.format(pty=bench.pty),
        source="handle",
        devices=HANDLE.format(folder=bench.folder),
    )


async def test_points_of_canopen_encoders_are_where_the_ball_was(
    bench: Workbench,
) -> None:
    motions = (rest(1.0), SPHERE.format(points=4), rest(1.0))
    bench.write_simulator(*motions, board=ENCODERS)
    write_daemon(bench)
    async with measuring(bench) as (listener, _, _):
        await listener.n_points(4)
        reply = await listener.command(PointArgs())
        assert reply.ok, reply
        await listener.n_points(5)
        (drivers,) = [s.drivers for s in listener.statuses[-1:]]
        health = listener.healths[-1]
    assert [d.driver for d in drivers] == ["canopen", "latch-board"]
    assert "12:53-1960001-3e9" in drivers[0].identity["name"]
    points = list({point.id: point for point in listener.points}.values())[:4]
    assert_where_the_ball_was(
        bench, points, bench.presses(), 2.0, by_several_clocks=True
    )
    assert not any("incomplete" in point.quality.flags for point in points)
    counters = next(d.counters for d in health.devices if d.id == "base")
    assert counters["samples_complete"] > 100
