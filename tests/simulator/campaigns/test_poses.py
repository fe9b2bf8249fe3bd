import numpy as np
import pytest

from tests.simulator.campaigns.arms import (
    ball_centres_mm,
    coupled,
    seven_joint_arm,
    six_joint_arm,
)
from traverse.kinematics.arm_file.arm import effect_from_table, write_arm
from traverse.recording.reader import read_recording
from traverse.simulator.campaigns import (
    MIXES,
    BallBar,
    CampaignSpec,
    ConditionTable,
    Cone,
    DrawWire,
    NoiseTable,
    ParallelPlanes,
    Plane,
    Points,
    PoseSet,
    Seats,
    Sphere,
    UnreachableError,
    draw_noise,
    make_poses,
    true_arm_file,
)
from traverse.simulator.campaigns.command import scan_made
from traverse.simulator.campaigns.dense.scan import NOTHING, simulate_scan
from traverse.simulator.campaigns.dense.spec import DenseFile
from traverse.simulator.campaigns.dense.writing import write_scan
from traverse.strict_toml.problems import FileError

ARM = seven_joint_arm()
BALL_MM = ARM.probe.radius_mm
SEED = 5


def touched(*artefacts, arm=ARM, **keys) -> PoseSet:
    return make_poses(arm, CampaignSpec(artefacts=artefacts, **keys), SEED)


def true_centres_mm(poses: PoseSet) -> np.ndarray:
    readings_rad = poses.turns_rad + poses.truth.zeros_rad
    return ball_centres_mm(true_arm_file(poses.arm, poses.truth), readings_rad)


def assert_equal_mm(actual, expected):
    np.testing.assert_allclose(actual, expected, atol=1e-9, rtol=0)


def test_a_cone_holds_the_ball_in_one_point():
    poses = touched(Cone(id="c", n_poses=30))
    (placed,) = poses.artefacts
    point_mm = placed.true_table()["point_mm"]
    assert_equal_mm(true_centres_mm(poses), np.tile(point_mm, (30, 1)))
    assert np.all(np.isnan(poses.around.towards))


def test_encoders_of_coupled_joints_show_what_makes_the_hinges_turn():
    arm = coupled(ARM, J3=("J2", -1.0), J5=("J3", 0.5))
    poses = touched(Cone(id="c", n_poses=10), arm=arm)
    readings_rad = poses.faulty.readings_rad(poses.turns_rad, poses.around)
    true = true_arm_file(arm, poses.truth)
    (placed,) = poses.artefacts
    expected_mm = np.tile(placed.true_table()["point_mm"], (10, 1))
    assert_equal_mm(ball_centres_mm(true, readings_rad), expected_mm)


def test_seats_in_a_row_are_as_far_apart_as_they_are_said_to_be():
    spec = Seats(id="b", n_poses=30, n_seats=3, distance_mm=80.0)
    poses = touched(spec)
    found_mm = true_centres_mm(poses)
    (placed,) = poses.artefacts
    points_mm = np.array(list(placed.true_table()["points_mm"].values()))
    assert_equal_mm(found_mm, points_mm[poses.feature_index])
    assert_equal_mm(np.linalg.norm(points_mm[1:] - points_mm[0], axis=1), [80.0, 160.0])
    assert [
        entry["distance_mm"]
        for entry in placed.artefact.stated(np.random.default_rng(1), placed.placement)[
            "distances"
        ]
    ] == [80.0, 160.0]


def test_a_wire_reads_how_far_the_ball_is_less_its_offset():
    wire = DrawWire(
        id="w", n_poses=30, shortest_mm=60.0, longest_mm=200.0, offset_mm=35.0
    )
    poses = touched(wire, Cone(id="c", n_poses=2))
    drawn = draw_noise(poses, 1, NoiseTable(contact_mm=0.0))
    of_wire = poses.artefact_index == 0
    anchor_mm = poses.artefacts[0].true_table()["anchor_mm"]
    away_mm = np.linalg.norm(true_centres_mm(poses) - anchor_mm, axis=1)
    assert_equal_mm(drawn.campaign.length_mm[of_wire], away_mm[of_wire] - 35.0)
    assert np.all(np.isnan(drawn.campaign.length_mm[~of_wire]))
    assert np.all((away_mm[of_wire] > 59.9) & (away_mm[of_wire] < 200.1))


@pytest.mark.parametrize(("side", "sign"), [("outside", 1.0), ("inside", -1.0)])
def test_a_sphere_is_touched_at_one_ball_radius(side, sign):
    poses = touched(Sphere(id="s", n_poses=40, radius_mm=25.0, side=side))
    table = poses.artefacts[0].true_table()
    offsets_mm = true_centres_mm(poses) - table["centre_mm"]
    distances_mm = np.linalg.norm(offsets_mm, axis=1)
    assert_equal_mm(distances_mm, 25.0 + sign * BALL_MM)
    np.testing.assert_allclose(
        poses.around.towards, -sign * offsets_mm / distances_mm[:, None], atol=1e-10
    )


def test_both_spheres_of_a_bar_are_touched_and_their_distance_is_true():
    bar = BallBar(
        id="b", n_poses=41, radius_mm=12.0, second_radius_mm=8.0, distance_mm=300.0
    )
    poses = touched(bar)
    table = poses.artefacts[0].true_table()
    centres_mm = np.array(table["centres_mm"])
    assert_equal_mm(np.linalg.norm(centres_mm[1] - centres_mm[0]), 300.0)
    offsets_mm = true_centres_mm(poses) - centres_mm[poses.feature_index]
    radii_mm = np.array([12.0, 8.0])[poses.feature_index]
    assert_equal_mm(np.linalg.norm(offsets_mm, axis=1), radii_mm + BALL_MM)
    assert np.bincount(poses.feature_index).tolist() == [21, 20]


def test_a_plane_is_touched_from_its_outer_side():
    poses = touched(Plane(id="p", n_poses=40, size_mm=200.0))
    table = poses.artefacts[0].true_table()
    heights_mm = true_centres_mm(poses) @ table["normal"] - table["offset_mm"]
    assert_equal_mm(heights_mm, BALL_MM)
    np.testing.assert_allclose(poses.around.towards @ table["normal"], -1.0, rtol=1e-12)


@pytest.mark.parametrize(("side", "sign"), [("outside", 1.0), ("inside", -1.0)])
def test_parallel_planes_are_touched_at_one_ball_radius(side, sign):
    gauge = ParallelPlanes(
        id="g", n_poses=40, distance_mm=100.0, size_mm=60.0, side=side
    )
    poses = touched(gauge)
    table = poses.artefacts[0].true_table()
    first_mm, second_mm = table["offsets_mm"]
    assert_equal_mm(second_mm - first_mm, 100.0)
    heights_mm = true_centres_mm(poses) @ table["normal"]
    is_second = poses.feature_index == 1
    assert_equal_mm(heights_mm[~is_second], first_mm - sign * BALL_MM)
    assert_equal_mm(heights_mm[is_second], second_mm + sign * BALL_MM)
    towards = poses.around.towards @ table["normal"]
    np.testing.assert_allclose(towards, np.where(is_second, -sign, sign), rtol=1e-12)


@pytest.mark.parametrize(
    ("frame", "scale"), [("arm", 1.0), ("own", 1.0), ("own_scaled", 1.002)]
)
def test_points_are_where_their_seven_parameters_put_them(frame, scale):
    grid = Points(id="g", n_poses=24, n_points=6, size_mm=200, frame=frame, scale=scale)
    poses = touched(grid)
    (placed,) = poses.artefacts
    table = placed.true_table()
    stated_mm = placed.artefact.stated(np.random.default_rng(1), placed.placement)
    known_mm = np.array([stated_mm["points_mm"][f"P{k + 1}"] for k in range(6)])
    if frame != "arm":
        rotation = np.array(table["rotation"])
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(rotation) > 0.0
        known_mm = [table["translation_mm"] + scale * rotation @ p for p in known_mm]
    assert_equal_mm(true_centres_mm(poses), np.array(known_mm)[poses.feature_index])


def test_a_warm_standard_is_longer_by_its_expansion():
    bar = BallBar(
        id="b", n_poses=40, radius_mm=10.0, distance_mm=300.0, expansion_per_c=12e-6
    )
    poses = touched(bar, conditions=ConditionTable(temperature_c=30.0))
    centres_mm = true_centres_mm(poses)
    centres = []
    for feature in (0, 1):
        at_mm = centres_mm[poses.feature_index == feature]
        # |x|^2 = 2 x.c + (R^2 - |c|^2) is linear in the centre c.
        design = np.column_stack([2.0 * at_mm, np.ones(len(at_mm))])
        centres.append(np.linalg.lstsq(design, np.sum(at_mm**2, axis=1))[0][:3])
    distance_mm = np.linalg.norm(centres[1] - centres[0])
    np.testing.assert_allclose(distance_mm, 300.0 * (1 + 12e-6 * 10.0), atol=1e-7)


@pytest.mark.parametrize(
    ("travel", "roll_deg", "hinge_deg"),
    [("full", 180, 180), ("wide", 150, 75), ("narrow", 60, 40)],
)
def test_turns_stay_within_the_named_travel(travel, roll_deg, hinge_deg):
    poses = make_poses(ARM, CampaignSpec(mix="cones", n_poses=200, travel=travel), SEED)
    # J1, J3, J5, J7 of this arm turn about the elements that they carry.
    largest = np.deg2rad([roll_deg, hinge_deg] * 3 + [roll_deg])
    np.testing.assert_allclose(poses.limits_rad, np.stack([-largest, largest], 1))
    assert np.all(np.abs(poses.turns_rad) <= largest)
    assert np.all(np.ptp(poses.turns_rad, axis=0) > 1.3 * largest)


def test_turns_stay_within_limits_of_ones_own():
    limits = tuple((-0.5 - 0.1 * k, 1.0) for k in range(7))
    poses = touched(Cone(id="c", n_poses=60), limits_rad=limits)
    assert np.all(poses.turns_rad >= np.array(limits)[:, 0])
    assert np.all(poses.turns_rad <= 1.0)


def test_a_cone_is_touched_in_postures_that_use_the_whole_travel():
    poses = touched(Cone(id="c", n_poses=100))
    spread = np.std(poses.turns_rad, axis=0)
    even = np.ptp(poses.limits_rad, axis=1) / np.sqrt(12.0)
    assert np.median(spread / even) > 0.7


def test_an_arm_of_six_joints_touches_everything():
    spec = CampaignSpec(mix="everything", n_poses=90)
    poses = make_poses(six_joint_arm(), spec, SEED)
    assert poses.turns_rad.shape == (90, 6)


@pytest.mark.parametrize("mix", MIXES)
def test_a_mix_deals_its_poses_out_evenly(mix):
    poses = make_poses(ARM, CampaignSpec(mix=mix, n_poses=50), SEED)
    counts = np.bincount(poses.artefact_index)
    assert np.sum(counts) == 50
    assert len(counts) == len(MIXES[mix])
    assert np.ptp(counts) <= 1


def test_every_visit_goes_round_all_artefacts():
    cones = [Cone(id=f"c{k}", n_poses=5) for k in range(2)]
    poses = touched(*cones, conditions=ConditionTable(visits=2))
    assert poses.artefact_index.tolist() == [0, 0, 1, 1, 0, 0, 0, 1, 1, 1]
    assert np.all(np.diff(poses.around.time_s) > 0.0)


def test_the_temperature_swings_about_its_middle():
    conditions = ConditionTable(temperature_c=23.0, swing_c=2.0)
    poses = touched(Cone(id="c", n_poses=300), conditions=conditions)
    temperature_c = poses.around.temperature_c
    assert np.all(np.abs(temperature_c - 23.0) <= 2.0)
    assert np.ptp(temperature_c) > 2.0


def test_speeds_have_the_sense_of_the_approach():
    conditions = ConditionTable(speed_rad_s=0.1)
    poses = touched(Cone(id="c", n_poses=50), conditions=conditions)
    speed_rad_s = poses.around.speed_rad_s
    assert np.all(np.sign(speed_rad_s) == poses.around.approach)


def test_a_bar_longer_than_the_arm_is_reported():
    bar = BallBar(id="long", n_poses=10, radius_mm=10.0, distance_mm=5000.0)
    with pytest.raises(UnreachableError, match=r"ball_bar 'long'.*make it smaller"):
        touched(bar)


def test_all_that_does_not_fit_is_reported_at_once():
    artefacts = (
        Sphere(id="bowl", n_poses=9, radius_mm=2.0, side="inside"),
        BallBar(id="bar", n_poses=9, radius_mm=10.0, distance_mm=20.0),
        ParallelPlanes(
            id="gap", n_poses=9, distance_mm=5.0, size_mm=9.0, side="inside"
        ),
        Points(id="grid", n_poses=9, size_mm=100.0, scale=1.1),
        Points(id="net", n_poses=9, size_mm=100.0, frame="arm", expansion_per_c=1e-5),
    )
    with pytest.raises(FileError) as caught:
        touched(*artefacts, limits_rad=((-1.0, 1.0),))
    places = [problem.where for problem in caught.value.problems]
    assert places == ["limits_rad", *(f"artefacts[{k}]" for k in range(5))]


SPEC = """schema = "traverse/simulated-campaign/1"
arm = "arm.toml"
seed = 3
[deviations]
links_mm = 0.0
axes_rad = 0.0
zeros_rad = 0.0
[noise]
encoder_rad = 0.0
contact_mm = 0.0
[scan]
rate_hz = 100.0
seconds = 2.0
[[artefacts]]
id = "seat"
kind = "cone"
n_poses = 1
[[artefacts]]
id = "ball"
kind = "sphere"
radius_mm = 25.0
n_poses = 2
"""


def spec_file(**changes):
    ball = {"id": "ball", "kind": "sphere", "radius_mm": 25.0, "n_poses": 2}
    return DenseFile.model_validate(
        {
            "schema": "traverse/simulated-campaign/1",
            "arm": "arm.toml",
            "deviations": {"links_mm": 0.0, "axes_rad": 0.0, "zeros_rad": 0.0},
            "noise": {"encoder_rad": 0.0, "contact_mm": 0.0},
            "scan": {"rate_hz": 100.0, "seconds": 2.0},
            "artefacts": ({"id": "seat", "kind": "cone", "n_poses": 1}, ball),
            **changes,
        }
    )


@pytest.fixture(scope="module")
def plain():
    return simulate_scan(seven_joint_arm(), spec_file(), 3)


def test_the_ball_stays_on_its_artefact(plain):
    rows = np.arange(0, len(plain.around.time_s), 7)
    balls_mm = ball_centres_mm(plain.arm, plain.readings_rad[rows])
    touched = plain.touched[rows]
    seat_mm = balls_mm[touched == 0]
    assert np.max(np.ptp(seat_mm, axis=0)) < 1e-6
    ball_mm = balls_mm[touched == 1]
    # |x - c|^2 = rho^2 is linear in c and rho^2 - |c|^2.
    columns = np.column_stack([2.0 * ball_mm, np.ones(len(ball_mm))])
    solved = np.linalg.lstsq(columns, np.sum(ball_mm**2, axis=1), rcond=None)[0]
    radius_mm = np.sqrt(solved[3] + solved[:3] @ solved[:3])
    assert radius_mm == pytest.approx(25.0 + plain.arm.probe.radius_mm, abs=1e-5)
    assert np.max(np.ptp(plain.readings_rad[plain.touched == 0], axis=0)) > 0.5


def test_a_drag_follows_another_with_nothing_touched_between(plain):
    changes = np.flatnonzero(np.diff(plain.touched)) + 1
    order = plain.touched[np.append(0, changes)].tolist()
    assert order == [0, NOTHING, 1, NOTHING, 1]
    # No joint moves half a turn from sample to sample: counts can be unwrapped.
    assert np.max(np.abs(np.diff(plain.readings_rad, axis=0))) < 1.0


def test_latency_and_play_are_in_the_readings(plain):
    tables = [
        {"kind": "encoder_latency", "joint": "J2", "latency_s": 1e-3},
        {"kind": "backlash", "joint": "J4", "half_width_rad": 1e-4},
    ]
    effects = tuple(effect_from_table(table) for table in tables)
    arm = seven_joint_arm().model_copy(update={"effects": effects})
    scan = simulate_scan(arm, spec_file(), 3)
    errors = scan.readings_rad - plain.readings_rad
    speeds = np.gradient(plain.readings_rad, plain.around.time_s, axis=0)
    assert np.allclose(errors[:, 1], -1e-3 * speeds[:, 1], atol=1e-9)
    moving = np.abs(speeds[:, 3]) > 1e-3
    assert np.allclose(errors[moving, 3], 1e-4 * np.sign(speeds[moving, 3]))
    assert np.allclose(errors[:, [0, 2, 4, 5, 6]], 0.0)


def test_noise_is_correlated_as_asked():
    noise = {"encoder_rad": 1e-4, "serial_share": 0.5, "serial_phi": 0.8}
    arm, quiet = seven_joint_arm(), {"encoder_rad": 0.0, "contact_mm": 0.0}
    noisy = simulate_scan(arm, spec_file(noise={**noise, "contact_mm": 0.0}), 3)
    still = simulate_scan(arm, spec_file(noise=quiet), 3)
    errors = noisy.readings_rad - still.readings_rad
    assert np.std(errors) == pytest.approx(1e-4, rel=0.1)
    for lag in (1, 3):
        correlation = np.mean(errors[lag:] * errors[:-lag]) / np.mean(errors**2)
        assert correlation == pytest.approx(0.5 * 0.8**lag, abs=0.08)


def test_the_file_holds_the_counts(plain, tmp_path):
    write_scan(tmp_path, plain, 3)
    recording = read_recording(tmp_path / "scan.mcap")
    assert np.array_equal(recording.samples.counts, plain.counts)
    for joint, part in enumerate(plain.arm.joints):
        step_rad = part.encoder.sign * 2.0 * np.pi / part.encoder.counts_per_turn
        off_rad = (
            plain.readings_rad[:, joint] - step_rad * recording.samples.counts[:, joint]
        )
        turns = off_rad / (2.0 * np.pi)
        assert np.max(np.abs(turns - np.round(turns))) * 2.0 * np.pi < abs(step_rad)
    assert [t.artefact for t in recording.touching] == [
        "seat",
        None,
        "ball",
        None,
        "ball",
    ]
    assert np.all(recording.samples.received_ns > recording.samples.sample_time_ns)
    assert (recording.campaign_text or "").count("[[artefacts]]") == 2


def test_the_command_makes_a_folder(tmp_path, capsys):
    (tmp_path / "spec.toml").write_text(SPEC)
    write_arm(tmp_path / "arm.toml", seven_joint_arm())
    out = tmp_path / "out"
    assert scan_made(tmp_path / "spec.toml", out, 4) == 0
    assert "samples 1000, 600 of them touching" in capsys.readouterr().out
    names = {path.name for path in out.iterdir()}
    assert names == {"arm.toml", "campaign.toml", "scan.mcap", "truth"}
    assert 'poses = "scan.mcap"' in (out / "campaign.toml").read_text()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[scan]", "[scn]", "scn"),
        ("rate_hz = 100.0", "rate_hz = 1.0", "rate_hz"),
        ("[noise]", "[noise]\nblunder_share = 0.1", "a scan has no blunders"),
        ('kind = "cone"', 'kind = "plane"\nsize_mm = [9.0, 9.0]', "artefacts[0]"),
        ("seconds = 2.0", "seconds = 2.0\nswing = 1.0\nwave_s = 0.21", "followed"),
    ],
)
def test_what_cannot_be_made_is_refused(tmp_path, capsys, old, new, words):
    (tmp_path / "spec.toml").write_text(SPEC.replace(old, new))
    write_arm(tmp_path / "arm.toml", seven_joint_arm())
    assert scan_made(tmp_path / "spec.toml", tmp_path / "out", None) == 2
    assert words in capsys.readouterr().err
