import numpy as np
import pytest

from tests.end_to_end.agreement import assert_one_point_an_edge, covariance
from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import CONE, DEMO_ARM, REST, SPHERE, Workbench, rest
from traverse.kinematics.arm_file.arm import read_arm
from traverse.protocol.messages import (
    LabelArgs,
    PointArgs,
    ProbeArgs,
    Reply,
    SessionArgs,
    UndoArgs,
)

pytestmark = pytest.mark.needs("mosquitto")

CENTRE_MM, RADIUS_MM = np.array([700.0, 100.0, 120.0]), 50.8
BALL_MM = read_arm(DEMO_ARM).probe.radius_mm
LIBRARY = """\
schema = "traverse/probes/1"
[[probes]]
name = "long"
radius_mm = 1.5
vector_mm = [150.0, 0.0, 0.0]
direction = [1.0, 0.0, 0.0]
kind = "hard"
vector_covariance_mm2 = [1e-6, 0.0, 0.0, 1e-6, 0.0, 1e-6]
"""


def result(reply: Reply) -> dict[str, object]:
    assert reply.ok, reply.error
    return dict(reply.result or {})


async def test_a_list_with_means_labels_undos_and_a_new_session(
    bench: Workbench,
) -> None:
    bench.write_simulator(REST, arm="noise_rad = 5e-6")
    bench.write_daemon()
    (bench.folder / "probes.toml").write_text(LIBRARY, "utf-8")
    bench.change(
        "daemon.toml", 'file = "arm.toml"', 'file = "arm.toml"\nprobes = "probes.toml"'
    )
    async with measuring(bench) as (listener, _, _):
        first = result(await listener.command(PointArgs()))
        await listener.command(LabelArgs(artefact="bar", feature="1"))
        mean = result(await listener.command(PointArgs(samples=30)))
        dwelt = result(await listener.command(PointArgs(dwell_s=0.2)))
        undone = result(await listener.command(UndoArgs()))
        guarded = await listener.command(UndoArgs(id=str(first["id"])))
        probe = result(await listener.command(ProbeArgs(name="long")))
        await listener.command(PointArgs())
        session = result(await listener.command(SessionArgs(action="new", note="two")))
        await listener.command(PointArgs())
        await listener.n_points(6)
        statuses = listener.statuses
        await listener.event("capture.session")
    async with measuring(bench) as (repeated, _, _):  # the probe is still on the arm
        await repeated.command(PointArgs())
        await repeated.n_points(1)
    assert repeated.points[-1].probe_radius_mm == 1.5
    assert repeated.points[-1].model == probe["model"]
    points = listener.points
    online = [s for s in statuses if s.online]
    shown_labels = [(s.label and s.label.artefact, s.probe, s.probes) for s in online]
    assert shown_labels[0] == (None, None, ("long",))
    assert ("bar", None, ("long",)) in shown_labels
    assert ("bar", "long", ("long",)) in shown_labels
    assert shown_labels[-1] == (None, "long", ("long",))
    assert [p.seq for p in points] == [0, 1, 2, 3, 4, 0]
    assert [p.retracts for p in points] == [None, None, None, dwelt["id"], None, None]
    assert undone["retracts"] == dwelt["id"]
    assert not guarded.ok
    assert guarded.error is not None
    assert str(mean["id"]) in guarded.error.text
    labels = [p.label.artefact for p in points]
    assert labels == [None, "bar", "bar", "bar", "bar", None]
    assert [p.samples for p in points[:2]] == [1, 30]
    assert points[2].samples == pytest.approx(21, abs=2)
    assert points[1].spread_mm is not None
    assert 0.0 < points[1].spread_mm < 0.05
    # A mean is more precise than one sample, and what is left is the contact.
    single, averaged = (np.trace(covariance(p)) for p in points[:2])
    assert 3 * 0.005**2 < averaged < 0.6 * single
    assert [p.probe_radius_mm for p in points] == [BALL_MM] * 4 + [1.5] * 2
    assert points[4].model == probe["model"] != points[0].model
    assert {p.session for p in points[:5]} == {points[0].session}
    assert points[5].session == session["session"] == statuses[-1].session
    assert statuses[-1].model == probe["model"]


async def test_buttons_with_gestures_take_each_click_where_it_was_pressed(
    bench: Workbench,
) -> None:
    bench.write_simulator(SPHERE.format(points=5))
    bench.write_daemon(capture="double_s = 0.05")
    bench.change(
        "daemon.toml",
        'trigger = "button"',
        'trigger = "button", double = "undo", hold = "scan"',
    )
    async with measuring(bench) as (listener, _, _):
        await listener.n_points(5)
    assert_one_point_an_edge(bench, listener.points, bench.presses())


@pytest.mark.slow
async def test_a_hold_averages_from_its_press_on(bench: Workbench) -> None:
    bench.write_simulator(CONE.format(postures=2), arm="noise_rad = 5e-6")
    bench.change("simulator.toml", "press_s = 0.03", "press_s = 0.8")
    bench.change("simulator.toml", "dwell_s = 0.06", "dwell_s = 0.2")
    bench.write_daemon(capture="average_s = 0.3\nhold_s = 0.2")
    bench.change(
        "daemon.toml",
        'trigger = "button"',
        'trigger = "button", click = "none", hold = "average"',
    )
    async with measuring(bench) as (listener, _, _):
        await listener.n_points(2)
        await listener.event("button.hold")
    presses = bench.presses()
    assert len(presses) == len(listener.points) == 2
    for point, edge in zip(listener.points, presses, strict=True):
        assert point.samples == pytest.approx(31, abs=2)
        off_mm = np.linalg.norm(np.array(point.xyz_mm) - edge["centre_mm"])
        assert off_mm < 5.0 * np.sqrt(np.trace(covariance(point)))


async def test_the_touched_point_lies_on_the_sphere(bench: Workbench) -> None:
    bench.change("arm.toml", '"hard"', '"switching"')
    lead_in = rest(3.0)  # until the clock of the board is tied
    bench.write_simulator(lead_in, SPHERE.format(points=5))
    bench.write_daemon(
        trigger="switch",
        capture='tracking_rate_hz = 1000.0\ncompensation = "pretouch"\n'
        "pretouch_mm = 5.0",
    )
    async with measuring(bench) as (listener, _, _):
        await listener.n_points(5)
    points = listener.points
    assert {p.compensation for p in points} == {"pretouch"}
    assert all(p.quality.ok for p in points)
    centres_mm = np.array([p.xyz_mm for p in points])
    truth = [e for e in bench.presses() if e["input_name"] == "switch"]
    assert np.abs(centres_mm - [e["centre_mm"] for e in truth]).max() < 0.01
    surfaces_mm = np.array([p.surface_mm for p in points])
    reach_mm = np.linalg.norm(surfaces_mm - centres_mm, axis=1)
    assert reach_mm == pytest.approx(BALL_MM)
    radii_mm = np.linalg.norm(surfaces_mm - CENTRE_MM, axis=1)
    assert radii_mm == pytest.approx(RADIUS_MM, abs=0.03)
