import json

import pytest

from tests.end_to_end.listener import Listener
from tests.end_to_end.measuring import measuring
from tests.end_to_end.programs import Program
from tests.end_to_end.workbench import Workbench
from tests.mosquitto import HOST, free_port
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")
DOUBT = "device.turns_uncertain"


async def traverse(
    bench: Workbench, *command: str, by_name: bool = True
) -> tuple[int, str, str]:
    """Exit status, output and errors of `traverse COMMAND` at the bench's broker."""
    where = ("--broker", f"{bench.host}:{bench.port}")
    if by_name:
        where += ("--arm-name", bench.arm)
    with Program(bench.folder, command[0], *command, *where) as program:
        status = await program.ended()
        return status, program.output.strip(), program.log.strip()


def alarms(listener: Listener) -> list[str]:
    return [alarm.code for alarm in listener.statuses[-1].alarms or ()]


@pytest.mark.slow
async def test_an_arm_is_commanded_from_a_terminal(resting: Workbench) -> None:
    async with measuring(resting) as (listener, _, _):
        status, output, _ = await traverse(resting, "label", "bar", "1")
        assert (status, output) == (0, "label: bar 1")
        status, output, _ = await traverse(resting, "point", "--samples", "5", "--json")
        assert status == 0
        point = json.loads(output)
        assert point["label"] == {"artefact": "bar", "feature": "1"}
        assert point["samples"] == 5
        # The only arm that is on line need not be named.
        assert await traverse(resting, "label", by_name=False) == (
            0,
            "points have no label",
            "",
        )
        status, output, _ = await traverse(resting, "point")
        assert status == 0
        assert "point     1" in output
        assert output.endswith(" mm")
        assert (await traverse(resting, "undo"))[0] == 0
        await listener.n_points(3)
        assert [p.retracts for p in listener.points] == [
            None,
            None,
            listener.points[1].id,
        ]
        status, output, _ = await traverse(resting, "scan", "start", "--rate-hz", "50")
        assert output.endswith("is running")
        assert (await traverse(resting, "scan", "stop"))[1] == "no scan is running"
        await listener.scan_ended(output.split()[1])
        status, output, _ = await traverse(resting, "session", "--note", "second shift")
        assert output != listener.points[0].session
        assert (await traverse(resting, "align", "--clear", by_name=False))[0] == 0
        assert (await traverse(resting, "reload"))[1].startswith("model ")
        assert (await traverse(resting, "confirm"))[1] == "nothing was in doubt"
        status, _, errors = await traverse(resting, "probe", "use", "ruby")
        assert status == 2
        assert "names no probe library" in errors


@pytest.mark.slow
async def test_refusals_say_what_is_wrong(resting: Workbench) -> None:
    async with measuring(resting):
        status, _, errors = await traverse(resting, "undo")
        assert (status, errors.count("\n")) == (2, 0)
        assert "Traceback" not in errors
        status, _, errors = await traverse(resting, "confirm", "--at", "1,2")
        assert status == 2
        assert "expected x,y,z in mm" in errors
        assert (await traverse(resting, "scan", "go"))[0] == 2
        assert (await traverse(resting, "point", "--samples", "2", "--seconds", "1"))[
            0
        ] == 2
    resting.host, resting.port = HOST, free_port()
    status, _, errors = await traverse(resting, "point")
    assert status == 3
    assert "broker" in errors


@pytest.mark.slow
async def test_points_are_in_doubt_after_a_loss_of_power_until_confirmed(
    resting: Workbench,
) -> None:
    resting.change("arm.toml", "absolute = true", "absolute = false")
    async with measuring(resting) as (listener, simulator, _):
        status, _, errors = await traverse(resting, "point")
        assert (status, errors) == (0, "")
        await resting.kill_simulator(simulator)
        await listener.event("device.lost", active=True)
        with resting.simulator("simulator-again") as repeated:
            await until(lambda: len(listener.events_of(DOUBT, True)) == 2, "the doubt")
            doubt = listener.events_of(DOUBT, True)[
                -1
            ]  # the first was of the beginning
            assert doubt.severity == "error"
            assert "base has been without power" in doubt.text
            in_doubt = "a status in doubt"
            await until(lambda: listener.statuses[-1].state == "doubt", in_doubt)
            # Whoever connects only now learns it from the retained status.
            await until(lambda: alarms(listener) == [DOUBT], "the alarm in the status")
            status, output, _ = await traverse(resting, "point")
            assert status == 1
            assert "turns_uncertain" in output
            x_mm, y_mm, z_mm = listener.points[0].xyz_mm
            status, _, errors = await traverse(
                resting, "confirm", "--at", f"{x_mm + 5.0},{y_mm},{z_mm}"
            )
            assert status == 2
            assert "5.000 mm from the known point" in errors
            place = f"{x_mm},{y_mm},{z_mm}"
            status, output, _ = await traverse(resting, "confirm", "--at", place)
            assert (status, output) == (0, "the positions of base have been confirmed")
            await until(lambda: not alarms(listener), "no alarm in the status")
            assert (await traverse(resting, "point"))[0] == 0
            assert await repeated.stop() == 0
    flags = [p.quality.flags for p in listener.points]
    assert flags == [(), ("turns_uncertain",), ()]


async def test_any_command_can_be_sent(resting: Workbench) -> None:
    async with measuring(resting):
        words = ("send", "session", "action=new", "note=the second one")
        status, output, errors = await traverse(resting, *words, "--json")
        assert (status, errors) == (0, "")
        session = json.loads(output)["session"]
        status, output, _ = await traverse(resting, "point", "--json")
        assert json.loads(output)["session"] == session
        status, output, _ = await traverse(
            resting, "send", "resend", f"session={session}"
        )
        assert status == 0
        assert "points: 1" in output
        for words, fault in (
            (("align", "action=set"), "rotation"),
            (("brew",), "expected one of point, scan"),
            (("session", "action"), "expected KEY=VALUE"),
        ):
            status, _, errors = await traverse(resting, "send", *words)
            assert status == 2
            assert fault in errors


@pytest.mark.slow
async def test_an_arm_is_homed_from_a_terminal(resting: Workbench) -> None:
    names = [f"J{k}" for k in range(1, 8)]
    home = dict(zip(names, (0.1, 0.2, -0.3, 0.4, 0.5, -0.6, 0.7), strict=True))
    table = ", ".join(f"{name} = {angle}" for name, angle in home.items())
    resting.change("arm.toml", "absolute = true", "absolute = false")
    resting.change(
        "arm.toml", "[probe]", f"[home]\nangles_rad = {{ {table} }}\n[probe]"
    )
    async with measuring(resting):
        status, output, errors = await traverse(resting, "home", "--json")
        assert (status, errors) == (0, "")
        assert json.loads(output) == {"homed": names}
        status, output, _ = await traverse(resting, "point", "--json")
        assert status == 0
        angles_rad = json.loads(output)["angles_rad"]
    assert angles_rad == pytest.approx(list(home.values()), abs=2e-5)


@pytest.mark.slow
async def test_power_lost_while_the_daemon_was_away_is_noticed(
    resting: Workbench,
) -> None:
    resting.change("arm.toml", "absolute = true", "absolute = false")
    async with measuring(resting):
        pass  # the board's power-up is now stored in its folder
    async with measuring(resting) as (listener, _, _):
        doubt = await listener.event(DOUBT, active=True)
        assert "base has been without power" in doubt.text
        # `measuring` has confirmed it.
        assert await traverse(resting, "confirm") == (0, "nothing was in doubt", "")
