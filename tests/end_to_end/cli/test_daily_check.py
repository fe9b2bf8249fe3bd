"""`traverse daily-check` beside a daemon that measures: guided, and in the history."""

import json

import pytest

from tests.end_to_end.measuring import measuring
from tests.end_to_end.programs import Program
from tests.end_to_end.workbench import CONE, SPHERE, Workbench
from traverse.lab.daily_check.history import checks_of

pytestmark = pytest.mark.needs("mosquitto")

LEAD_IN = '[[motion]]\nkind = "rest"\nduration_s = 1.0'


async def test_a_daily_check_is_collected_and_kept(bench: Workbench) -> None:
    bench.write_simulator(LEAD_IN, CONE.format(postures=10), SPHERE.format(points=9))
    bench.write_daemon(capture="live_rate_hz = 100.0")
    where = ["--broker", f"{bench.host}:{bench.port}"]
    words = ["daily-check", "--arm", "arm.toml", "--config", "daemon.toml"]
    checking = Program(
        bench.folder, "daily-check", *words, *where, "--radius", "50.8", "--json"
    )
    with checking:
        await checking.says("cone left: the cone, 5 points with the elbow to the left")
        await checking.says("following")
        async with measuring(bench) as (listener, _, _):
            await listener.n_points(19)
            assert await checking.ended() == 0
    told = json.loads(checking.output)
    values = {figure["key"]: figure["value_mm"] for figure in told["figures"]}
    assert told["in_control"] is True
    # A count of the simulated encoders is 12 um at the tip, at most.
    assert 0.0 < values["spat_max_mm"] < values["spat_2s_mm"] < 0.05
    assert abs(values["sphere_diameter_mm"]) < 0.05
    (check,) = checks_of(bench.folder / "state" / "interim.db", bench.arm)
    assert (check.figures.n_cone, check.figures.n_sphere) == (10, 9)
    assert check.figures.sphere_radius_mm == pytest.approx(50.8)
