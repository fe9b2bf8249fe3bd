import json
import subprocess
import sys
from typing import IO

import pytest

from tests.end_to_end.agreement import is_marked_for_time
from tests.end_to_end.measuring import measuring
from tests.end_to_end.programs import Program
from tests.end_to_end.workbench import CONE, SPHERE, Workbench, rest
from traverse.installation import remedy
from traverse.lab.campaign.campaign_file import read_campaign_file
from traverse.lab.daily_check.history import checks_of
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")

LEAD_IN = rest(4.0)
N_TOUCHES = 19
TRIES = 3


async def all_touches_count(bench: Workbench) -> bool:
    """Touch cone and sphere; return whether no touch is left out.

    A busy machine may leave the clock in doubt at some. An operator would touch again
    then; the simulated one has no more touches, and the check has to begin anew.
    """
    async with measuring(bench) as (listener, _, _):
        await listener.n_points(N_TOUCHES)
    return not any(map(is_marked_for_time, listener.points))


WITHOUT_SCIPY = (
    "import sys; sys.modules['scipy'] = None\n"
    "from traverse.cli.__main__ import main; main()"
)


def without_scipy(
    bench: Workbench, words: list[str], out: IO[str]
) -> subprocess.Popen[bytes]:
    """Start a command of Traverse where scipy is not installed."""
    return subprocess.Popen(
        [sys.executable, "-u", "-c", WITHOUT_SCIPY, *words],
        cwd=bench.folder,
        stdin=subprocess.DEVNULL,
        stdout=out,
        stderr=out,
    )


@pytest.mark.slow
async def test_without_scipy_it_says_so_first_and_computes_later(
    bench: Workbench,
) -> None:
    bench.write_simulator(LEAD_IN, CONE.format(postures=10), SPHERE.format(points=9))
    bench.write_daemon(capture="live_rate_hz = 100.0")
    words = ["daily-check", "--arm", "arm.toml", "--history", "interim.db"]
    where = ["--broker", f"{bench.host}:{bench.port}", "--radius", "50.8"]

    def output() -> str:
        return (bench.folder / "out").read_text("utf-8")

    for _ in range(TRIES):
        with (
            (bench.folder / "out").open("w+") as out,
            without_scipy(bench, [*words, *where], out) as process,
        ):
            await until(lambda: "following" in output(), "it follows")
            before = output()
            assert f"needs scipy, which is not installed; {remedy('lab')}" in before
            assert before.index("needs scipy") < before.index("cone left: the cone")
            if await all_touches_count(bench):
                await until(lambda: process.poll() is not None, "it ends")
                break
            process.kill()
    assert process.returncode == 2
    folder = output().strip().rpartition(" ")[2]
    later = f"traverse {' '.join(words)} --campaign {folder}"
    assert output().splitlines()[-1] == f"kept, and not judged; later: {later}"
    begun = read_campaign_file(bench.folder / folder / "campaign.toml").start_utc
    with Program(bench.folder, "later", *later.split()[1:]) as computed:
        assert await computed.ended() == 0
    assert "check since the base began" in computed.output
    (check,) = checks_of(bench.folder / "interim.db", bench.arm)
    assert begun is not None
    assert check.time_utc == f"{begun:%Y-%m-%dT%H:%M:%SZ}"  # when it was touched


@pytest.mark.slow
async def test_a_daily_check_is_collected_and_kept(bench: Workbench) -> None:
    bench.write_simulator(LEAD_IN, CONE.format(postures=10), SPHERE.format(points=9))
    bench.write_daemon(capture="live_rate_hz = 100.0")
    where = ["--broker", f"{bench.host}:{bench.port}"]
    words = ["daily-check", "--arm", "arm.toml", "--config", "daemon.toml"]
    words += [*where, "--radius", "50.8", "--json"]
    for _ in range(TRIES):
        with Program(bench.folder, "daily-check", *words) as checking:
            await checking.says("cone left: the cone, 5 points with the elbow to the")
            await checking.says("following")
            if await all_touches_count(bench):
                assert await checking.ended() == 0
                break
    outcome = json.loads(checking.output)
    values = {figure["key"]: figure["value_mm"] for figure in outcome["figures"]}
    assert outcome["state"] == "doubt"  # nothing judges a first check
    # A count of the simulated encoders is 12 um at the tip, at most.
    assert 0.0 < values["spat_max_mm"] < values["spat_2s_mm"] < 0.05
    assert abs(values["sphere_diameter_mm"]) < 0.05
    (check,) = checks_of(bench.folder / "state" / "interim.db", bench.arm)
    assert (check.figures.n_cone, check.figures.n_sphere) == (10, 9)
    assert check.figures.sphere_radius_mm == pytest.approx(50.8)
