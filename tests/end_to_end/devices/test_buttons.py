"""Buttons whose contact is not as the configuration has it, on a real line."""

import numpy as np
import pytest

from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import REST, SPHERE, Workbench, rest
from traverse.daemon.points.input_monitor import ACTIVE

pytestmark = pytest.mark.needs("mosquitto")


async def test_a_button_of_the_wrong_polarity_is_reported_and_takes_points_when_let_go(
    bench: Workbench,
) -> None:
    bench.write_daemon()
    trigger = 'trigger = "button"'
    bench.change("daemon.toml", trigger, f"{trigger}, normally_closed = true")
    bench.write_simulator(rest(4.0), SPHERE.format(points=3), REST)
    bench.change("simulator.toml", "press_s = 0.03", "press_s = 0.1")
    async with measuring(bench) as (listener, _, _):
        event = await listener.event(ACTIVE, active=True)
        assert "take normally_closed out" in event.remedy
        await listener.n_points(3)
        assert [alarm.code for alarm in listener.statuses[-1].alarms] == [ACTIVE]
    lets_go = [e for e in bench.truth() if e["event"] == "edge" and e["level"] == 0]
    gaps_s = np.diff([edge["time_s"] for edge in lets_go])
    times_s = np.array([point.time_ns for point in listener.points]) * 1e-9
    np.testing.assert_allclose(np.diff(times_s), gaps_s[: len(times_s) - 1], atol=1e-3)
