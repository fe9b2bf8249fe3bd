import pytest

from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import SPHERE, Workbench, rest
from traverse.broker.address import BrokerAddress
from traverse.client.display.follower import Follower, following
from traverse.client.display.inspection_desk import InspectionDesk
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")

PLANE = (
    '[[motion]]\nkind = "plane"\nartefact = "plate"\n'
    "centre_mm = [600.0, 0.0, 60.0]\nwidth_mm = 100.0\ndepth_mm = 100.0\n"
    "columns = 3\nrows = 3"
)
DIAMETER_MM, HEIGHT_MM = 101.6, 60.0


@pytest.mark.slow
async def test_features_are_within_their_uncertainty_of_the_truth(
    bench: Workbench,
) -> None:
    bench.write_simulator(
        rest(2.0), SPHERE.format(points=9), rest(2.0), PLANE, arm="noise_rad = 5e-6"
    )
    bench.write_daemon()
    follower = Follower(bench.arm, BrokerAddress(bench.host, bench.port))
    desk = InspectionDesk(follower.sight)
    async with measuring(bench) as (listener, _, _), following(follower):
        ball = desk.begin("sphere")
        desk.features[ball].side = "outside"
        await until(lambda: len(desk.features[ball].points) == 9, "9 touches")
        desk.accept()
        plate = desk.begin("plane")
        await until(lambda: len(desk.features[plate].points) == 9, "9 more")
        desk.accept()
        # A busy machine reads late: what is marked for that is left out, by hand.
        for point in listener.points:
            if point.quality.flags:
                desk.assign(point.id, None)
        desk.relate("distance", (ball, plate))
        assert await desk.measure(follower.shared_errors)
    inspection = desk.inspection
    assert inspection is not None
    assert inspection.uncertainty_unknown == ""
    assert {p.label.feature for p in listener.points} == {None}
    figures = {
        f"{feature.name} {figure.name}": figure
        for feature in inspection.features
        for figure in feature.figures
    }
    for name, truth in (
        ("sphere 1 diameter", DIAMETER_MM),
        ("sphere 1 x", 700.0),
        ("sphere 1 y", 100.0),
        ("sphere 1 z", 120.0),
        ("distance 1 distance", 120.0 - HEIGHT_MM),
        ("plane 1 form", 0.0),
    ):
        figure = figures[name]
        assert figure.expanded is not None
        assert 0.0 < figure.expanded < 0.1
        assert abs(figure.value - truth) <= figure.expanded, name
