"""RLS encoders at the base, Modbus encoders at the wrist, the button on a board."""

import pytest

from tests.end_to_end.agreement import assert_where_the_ball_was
from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import SPHERE, Workbench, rest
from traverse.protocol.messages import PointArgs

pytestmark = pytest.mark.needs("mosquitto")

PORTS = ["rls-0", "rls-1", "rls-2"]
ENCODERS = f"""\
kind = "rls"
ports = {PORTS}
bits = 18
[[device]]
kind = "modbus"
id = "wrist"
port = "wrist.pty"
addresses = [1, 2, 3, 4]
words = 1
position_register = 1
[[device]]
id = "handle"
port = "handle.pty"
inputs = ["button"]
"""
READ_BY = """\
driver = "rls"
ports = [{ports}]
bits = 18
answer_timeout_s = 0.1
max_speed_rad_s = 100.0
[[device]]
id = "wrist"
driver = "modbus"
port = "{folder}/wrist.pty"
baud_rate = 115200
parity = "none"
answer_timeout_s = 0.2
max_speed_rad_s = 100.0
{encoders}
[[device]]
id = "handle"
driver = "latch-board"
port = "{folder}/handle.pty"
"""
ENCODER = """
[[device.encoders]]
address = {address}
counts_per_turn = 65536
position_register = 1
words = 1
"""
AT_EASE = {
    'port = "board.pty"\n': "",
    "move_s = 0.1": "move_s = 0.6",
    "dwell_s = 0.06": "dwell_s = 0.5",
}


@pytest.fixture
def arm(bench: Workbench) -> Workbench:
    """J1 to J3 by RLS, J4 to J7 by Modbus."""
    text = bench.arm_file.read_text("utf-8").replace("8388608", "262144")
    head, wrist = text.split('name = "J4"')
    wrist = wrist.replace("262144", "65536").replace("4194304", "65536")
    for channel in range(3, 7):
        wrist = wrist.replace(f'"base/{channel}"', f'"wrist/{channel - 3}"')
    bench.arm_file.write_text(f'{head}name = "J4"{wrist}', "utf-8")
    return bench


def write_files(bench: Workbench) -> None:
    motions = (rest(1.5), SPHERE.format(points=3), rest(1.5))
    bench.write_simulator(*motions, board=ENCODERS)
    for old, new in AT_EASE.items():
        bench.change("simulator.toml", old, new)
    ports = ", ".join(f'"{bench.folder / port}"' for port in PORTS)
    encoders = "".join(ENCODER.format(address=n) for n in (1, 2, 3, 4))
    bench.write_daemon(
        capture="tracking_rate_hz = 20.0",
        read_by=READ_BY.format(ports=ports, folder=bench.folder, encoders=encoders),
        source="handle",
    )


@pytest.mark.slow
async def test_points_of_an_arm_of_two_makes_are_where_the_ball_was(
    arm: Workbench,
) -> None:
    write_files(arm)
    # On a busy machine answers are late again and again: its numbers stay in doubt.
    async with measuring(arm, state=None) as (listener, _, _):
        await listener.n_points(3)
        reply = await listener.command(PointArgs())
        assert reply.ok, reply
        drivers = listener.statuses[-1].drivers
    assert [d.driver for d in drivers] == ["rls", "modbus", "latch-board"]
    truth = arm.presses()
    assert {edge["device"] for edge in truth} == {"handle"}
    assert_where_the_ball_was(
        arm, listener.points[:3], truth, 2.0, by_several_clocks=True
    )
