import numpy as np
import pytest
from scipy import stats

from tests.simulator.campaigns.arms import ball_centres_mm, seven_joint_arm
from traverse.simulator.campaigns import (
    BallBar,
    CampaignSpec,
    Cone,
    NoiseTable,
    Plane,
    PoseSet,
    SimulatedCampaign,
    draw_noise,
    make_poses,
    simulate_campaign,
    true_arm_file,
)
from traverse.strict_toml.problems import FileError

ARM = seven_joint_arm()
QUIET = NoiseTable(encoder_rad=0.0, contact_mm=0.0)


@pytest.fixture(scope="module")
def poses() -> PoseSet:
    artefacts = (
        Cone(id="c1", n_poses=150),
        Cone(id="c2", n_poses=150),
        Plane(id="p", n_poses=300, size_mm=150.0),
        BallBar(
            id="b",
            n_poses=200,
            radius_mm=10.0,
            distance_mm=300.0,
            distance_std_mm=0.001,
            radius_std_mm=0.002,
        ),
    )
    return make_poses(ARM, CampaignSpec(artefacts=artefacts), 3)


def rows_of(poses: PoseSet, number: int) -> np.ndarray:
    return np.flatnonzero(poses.artefact_index == number)


def assert_variance(sample, variance):
    """Sums of squares within the 1 % and 99 % points of chi-square."""
    share = stats.chi2.cdf(np.sum(np.square(sample)) / variance, np.size(sample))
    assert 0.01 < share < 0.99


def heights_mm(
    poses: PoseSet, drawn: SimulatedCampaign, readings_rad, rows=None
) -> np.ndarray:
    """Misclosures at the plane, of some rows or all of it, by the paper's formula."""
    table = drawn.truth.artefacts[2].true_table()
    true = true_arm_file(poses.arm, poses.truth)
    rows = rows_of(poses, 2) if rows is None else rows
    centres_mm = ball_centres_mm(true, readings_rad[rows])
    return centres_mm @ table["normal"] - table["offset_mm"] - poses.truth.radius_mm


def test_without_noise_readings_are_the_truth(poses):
    drawn = draw_noise(poses, 1, QUIET)
    readings_rad = drawn.campaign.readings_rad
    np.testing.assert_array_equal(readings_rad, poses.turns_rad + poses.truth.zeros_rad)
    assert np.max(np.abs(heights_mm(poses, drawn, readings_rad))) < 1e-9


def test_encoder_noise_has_its_size_on_every_joint(poses):
    stds_rad = tuple(1e-6 * (k + 1) for k in range(7))
    noise = NoiseTable(encoders_rad=stds_rad, contact_mm=0.0)
    drawn = draw_noise(poses, 2, noise)
    errors_rad = drawn.campaign.readings_rad - poses.turns_rad - poses.truth.zeros_rad
    for k, std_rad in enumerate(stds_rad):
        assert_variance(errors_rad[:, k], std_rad**2)
    assert drawn.campaign.encoder_rad == pytest.approx(np.sqrt(20.0) * 1e-6)


def test_contact_noise_displaces_the_ball_along_the_normal_only(poses):
    drawn = draw_noise(poses, 2, NoiseTable(encoder_rad=0.0, contact_mm=0.01))
    off_mm = heights_mm(poses, drawn, drawn.campaign.readings_rad)
    assert_variance(off_mm, 0.01**2)
    shifts_mm = drawn.truth.contact_noise_mm[rows_of(poses, 2)]
    normal = np.array(drawn.truth.artefacts[2].true_table()["normal"])
    np.testing.assert_allclose(shifts_mm @ normal, off_mm, atol=1e-9)
    np.testing.assert_allclose(np.cross(shifts_mm, normal), 0.0, atol=1e-15)


def test_contact_noise_in_a_seat_goes_all_ways(poses):
    drawn = draw_noise(poses, 2, NoiseTable(encoder_rad=0.0, contact_mm=0.01))
    rows = rows_of(poses, 0)
    point_mm = drawn.truth.artefacts[0].true_table()["point_mm"]
    true = true_arm_file(poses.arm, poses.truth)
    misses_mm = ball_centres_mm(true, drawn.campaign.readings_rad[rows]) - point_mm
    for along_mm in misses_mm.T:
        assert_variance(along_mm, 0.01**2)
    np.testing.assert_allclose(misses_mm, drawn.truth.contact_noise_mm[rows], atol=1e-9)


def test_an_artefact_may_have_contact_noise_of_its_own():
    artefacts = (
        Plane(id="p", n_poses=100, size_mm=100.0, contact_mm=0.1),
        Plane(id="q", n_poses=100, size_mm=100.0),
    )
    drawn = simulate_campaign(ARM, CampaignSpec(artefacts=artefacts), 4)
    shifts_mm = np.linalg.norm(drawn.truth.contact_noise_mm, axis=1)
    is_rough = drawn.campaign.artefact == "p"
    assert_variance(shifts_mm[is_rough], 0.1**2)
    assert_variance(shifts_mm[~is_rough], 0.005**2)
    assert drawn.campaign.contact_mm == 0.005


def test_serial_noise_is_correlated_as_configured(poses):
    noise = NoiseTable(serial_share=0.5, serial_phi=0.9)
    errors = np.concatenate(
        [draw_noise(poses, seed, noise).truth.encoder_noise_rad.T for seed in range(30)]
    )
    errors = errors / noise.encoder_rad
    assert np.mean(errors**2) == pytest.approx(1.0, abs=0.02)
    for lag in (1, 2, 5):
        correlation = np.mean(errors[:, lag:] * errors[:, :-lag])
        assert correlation == pytest.approx(0.5 * 0.9**lag, abs=0.02)


def test_blunders_spoil_the_share_that_was_requested_and_nothing_else(poses):
    clean = draw_noise(poses, 6)
    spoilt = draw_noise(poses, 6, NoiseTable(blunder_share=0.05))
    rows = [blunder.row for blunder in spoilt.truth.blunders]
    assert len(rows) == 40
    assert rows == sorted(set(rows))
    changed = np.any(
        clean.campaign.readings_rad != spoilt.campaign.readings_rad, axis=1
    )
    assert np.flatnonzero(changed).tolist() == rows


@pytest.mark.parametrize("kind", ["contact", "encoder"])
def test_a_blunder_is_as_large_as_told_in_sigmas_of_the_misclosure(poses, kind):
    noise = NoiseTable(blunder_share=0.2, blunder_sigma=15.0, blunder_kinds=(kind,))
    clean, spoilt = draw_noise(poses, 6), draw_noise(poses, 6, noise)
    of_plane = rows_of(poses, 2)
    is_spoilt = np.isin(of_plane, [blunder.row for blunder in spoilt.truth.blunders])
    np.testing.assert_array_equal(
        spoilt.campaign.readings_rad[of_plane[~is_spoilt]],
        clean.campaign.readings_rad[of_plane[~is_spoilt]],
    )
    rows = of_plane[is_spoilt]
    assert len(rows) > 20
    moved_mm = heights_mm(poses, spoilt, spoilt.campaign.readings_rad, rows)
    moved_mm -= heights_mm(poses, clean, clean.campaign.readings_rad, rows)
    readings_rad = poses.turns_rad + poses.truth.zeros_rad
    variances_mm2 = np.full(len(rows), noise.contact_mm**2)
    for k in range(7):
        step_rad = np.zeros(7)
        step_rad[k] = 1e-5
        ahead = heights_mm(poses, clean, readings_rad + step_rad, rows)
        behind = heights_mm(poses, clean, readings_rad - step_rad, rows)
        variances_mm2 += ((ahead - behind) / 2e-5 * noise.encoder_rad) ** 2
    sigmas = np.abs(moved_mm) / np.sqrt(variances_mm2)
    np.testing.assert_allclose(sigmas, 15.0, rtol=5e-3)
    # J7 cannot be felt: the probe lies on its axis.
    names = {"contact": {""}, "encoder": {f"J{k}" for k in range(1, 7)}}
    assert {blunder.what for blunder in spoilt.truth.blunders} == names[kind]


def test_a_wrong_label_is_another_feature_or_another_of_the_kind(poses):
    noise = NoiseTable(blunder_share=0.2, blunder_kinds=("label",))
    clean, spoilt = draw_noise(poses, 6), draw_noise(poses, 6, noise)
    right, written = clean.campaign, spoilt.campaign
    np.testing.assert_array_equal(right.readings_rad, written.readings_rad)
    assert len(spoilt.truth.blunders) == 160
    for blunder in spoilt.truth.blunders:
        row = blunder.row
        assert blunder.what == f"{right.artefact[row]}/{right.feature[row]}"
        now = (written.artefact[row], written.feature[row])
        expected = {
            "c1/": ("c2", ""),
            "c2/": ("c1", ""),
            "b/1": ("b", "2"),
            "b/2": ("b", "1"),
        }
        assert now == expected[blunder.what]


def test_certificates_err_by_their_standard_deviation(poses):
    lengths, radii = [], []
    for seed in range(60):
        table = draw_noise(poses, seed, QUIET).campaign.artefacts[3].table
        assert table["distance_std_mm"] == 0.001
        assert table["radius_std_mm"] == 0.002
        lengths.append(table["distance_mm"] - 300.0)
        radii += [radius - 10.0 for radius in table["radius_mm"]]
    assert_variance(lengths, 0.001**2)
    assert_variance(radii, 0.002**2)


def test_quantised_readings_are_whole_counts(poses):
    drawn = draw_noise(poses, 1, NoiseTable(quantised=True))
    counts = drawn.campaign.readings_rad / (2.0 * np.pi) * 8388608
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-6)


def test_quantising_without_encoders_is_refused():
    joints = tuple(j.model_copy(update={"encoder": None}) for j in ARM.joints)
    bare = ARM.model_copy(update={"joints": joints})
    spec = CampaignSpec(mix="cones", n_poses=9, noise=NoiseTable(quantised=True))
    with pytest.raises(FileError, match="no encoder of J1, J2"):
        make_poses(bare, spec, 1)


def test_stated_directions_err_by_their_angle_and_seats_have_none(poses):
    drawn = draw_noise(poses, 1, NoiseTable(direction_rad=0.01))
    direction = drawn.campaign.direction
    assert direction is not None
    is_seat = np.isin(drawn.campaign.artefact, ["c1", "c2"])
    assert np.all(np.isnan(direction[is_seat]))
    stated, true = direction[~is_seat], poses.around.towards[~is_seat]
    np.testing.assert_allclose(np.linalg.norm(stated, axis=1), 1.0, rtol=1e-12)
    across = np.linalg.norm(np.cross(stated, true), axis=1)
    share = stats.chi2.cdf(np.sum(across**2) / 0.01**2, 2 * len(across))
    assert 0.01 < share < 0.99


def test_the_campaign_may_state_a_wrong_noise_or_none(poses):
    wrong = draw_noise(poses, 1, NoiseTable(stated_factor=1.4)).campaign
    assert wrong.encoder_rad == pytest.approx(7e-6)
    assert wrong.contact_mm == pytest.approx(7e-3)
    silent = draw_noise(poses, 1, NoiseTable(stated=False)).campaign
    assert silent.encoder_rad is None
    assert silent.contact_mm is None
