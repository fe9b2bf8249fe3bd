"""Dense scans, from the simulator's stream to the diagnosis."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from typer.testing import CliRunner

from tests.simulator.campaigns.arms import seven_joint_arm
from traverse.cli.__main__ import app
from traverse.kinematics.arm_file.arm import effect_from_table, read_arm
from traverse.lab.campaign.campaign import campaign_of_places, read_campaign
from traverse.lab.campaign.stream_table import senses_of, speeds_of, stretches_of
from traverse.lab.diagnosis.candidates.library import library_bank
from traverse.lab.diagnosis.candidates.scoring import judge, project
from traverse.lab.diagnosis.candidates.waves import harmonic_bank
from traverse.lab.diagnosis.diagnose import diagnose
from traverse.lab.diagnosis.model.fit import fitted
from traverse.lab.diagnosis.model.observation_equations import equations_of
from traverse.lab.diagnosis.model.result import DiagnosisOptions
from traverse.lab.diagnosis.scans.decimation import decimated
from traverse.lab.diagnosis.scans.harmonics import first_significant, stream_harmonics
from traverse.lab.diagnosis.scans.latencies import with_speeds_since
from traverse.lab.diagnosis.scans.scan_diagnosis import diagnose_stream
from traverse.simulator.campaigns.dense.scan import simulate_scan
from traverse.simulator.campaigns.dense.spec import DenseFile
from traverse.simulator.campaigns.dense.writing import write_scan

pytestmark = pytest.mark.slow

LATENCY = {"kind": "encoder_latency", "joint": "J5", "latency_s": 1e-4}
BACKLASH = {"kind": "backlash", "joint": "J3", "half_width_rad": 3e-5}
OPTIONS = DiagnosisOptions(n_draws=200, details=False)
SHARE, PHI = 0.6, 0.9


def scan_file(**more):
    seats = [{"id": f"cone-{i}", "kind": "cone", "n_poses": 3} for i in range(3)]
    ball = {"id": "ball", "kind": "sphere", "radius_mm": 25.0, "known": True}
    return DenseFile.model_validate(
        {
            "schema": "traverse/simulated-campaign/1",
            "arm": "arm.toml",
            "artefacts": (*seats, {**ball, "n_poses": 3}),
            "noise": {
                "encoder_rad": 4e-6,
                "contact_mm": 0.003,
                "serial_share": SHARE,
                "serial_phi": PHI,
            },
            "scan": {"rate_hz": 200.0, "seconds": 5.0},
            **more,
        }
    )


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Scans by the effects that were hidden; made on first use."""

    @cache
    def made(*effects):
        folder = tmp_path_factory.mktemp("scan")
        hidden = tuple(effect_from_table(json.loads(text)) for text in effects)
        arm = seven_joint_arm().model_copy(update={"effects": hidden})
        write_scan(folder, simulate_scan(arm, scan_file(), 5), 5)
        return folder

    return lambda *effects: made(*[json.dumps(effect) for effect in effects])


def read(folder):
    arm = read_arm(folder / "arm.toml")
    return arm, read_campaign(folder, [joint.name for joint in arm.joints])


def test_latency_and_backlash_are_found(folders, tmp_path):
    folder = folders(LATENCY, BACKLASH)
    arguments = ["diagnose", str(folder), "--arm", str(folder / "arm.toml")]
    ran = CliRunner().invoke(app, [*arguments, "--out", str(tmp_path / "out")])
    assert ran.exit_code == 0, ran.output
    result = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert result["verdict"] == "named"
    terms = {(term["kind"], term["joint"]): term for term in result["terms"]}
    assert set(terms) == {("encoder_latency", "J5"), ("backlash", "J3")}
    for table in (LATENCY, BACKLASH):
        key = "latency_s" if "latency_s" in table else "half_width_rad"
        estimate = terms[table["kind"], table["joint"]]["parameters"][key]
        assert abs(estimate["value"] - table[key]) < 4.0 * estimate["std"]
        assert estimate["std"] < 0.1 * table[key]
    assert result["gap"]["closed"] > 0.8
    stream = json.loads((tmp_path / "out" / "stream.json").read_text())
    assert stream["samples"] > 11_000
    # Effects look like noise that lasts: without them more poses are kept.
    _, first = decimated(*read(folder)[::-1])
    assert 1.3 * len(first.poses) < stream["poses"] <= 2000
    assert stream["rate_hz"] == pytest.approx(200.0)
    assert "samples at 200 Hz" in ran.output
    adapted = read_arm(tmp_path / "out" / "arm.toml")
    assert {effect.kind for effect in adapted.effects} == {
        "encoder_latency",
        "backlash",
    }


def test_noise_lasts_as_long_as_was_simulated(folders):
    arm, campaign = read(folders())
    thinned, thinning = decimated(campaign, arm)
    # Correlated until share phi^n is a fiftieth: 32 samples; a bit less, since
    # the mean over the motion is taken out.
    expected = np.log(0.02 / SHARE) / np.log(PHI) / 200.0
    for lasting_s in thinning.lasting_s:
        assert 0.5 * expected < lasting_s < 1.2 * expected
    lines = campaign.poses.lines[thinning.poses]
    assert np.min(np.diff(lines)) >= round(min(thinning.apart_s) * 200.0)
    touched = np.isfinite(thinned.poses.directions[:, 0])
    names = np.array([artefact.id for artefact in thinned.artefacts])
    assert set(names[thinned.poses.artefacts[touched]]) == {"ball"}
    lengths = np.linalg.norm(thinned.poses.directions[touched], axis=1)
    assert np.allclose(lengths, 1.0)


def test_what_correlation_is_left_hardly_widens_any_estimate(folders):
    """The true covariance of every estimate, from how the noise was simulated."""
    arm, campaign = read(folders())
    _, thinning = decimated(campaign, arm)
    poses = campaign.part(thinning.poses)
    everyone = np.ones(len(poses.poses), dtype=bool)
    rows = equations_of(fitted(poses, arm, everyone).adjustment)
    samples = poses.poses.lines[rows.poses]
    apart = np.abs(samples[:, None] - samples[None, :])
    covariance = SHARE * PHI**apart * (rows.sources @ rows.sources.T)
    covariance[np.diag_indices_from(covariance)] += 1.0 - SHARE
    ratios = [
        np.sqrt(np.einsum("rd,rs,sd->d", u, covariance, u, optimize=True))
        for u in (
            projection.directions
            for projection in project(rows, library_bank(rows, arm))
        )
    ]
    wider = np.concatenate(ratios)
    assert len(wider) > 100
    # White noise would give 1 throughout.
    assert 0.98 < np.median(wider) < 1.08
    assert wider.max() < 1.12


def test_fewer_poses_are_kept_where_more_would_be_too_many(folders):
    arm, campaign = read(folders(LATENCY, BACKLASH))
    _, thinning = decimated(campaign, arm, most_poses=100)
    assert 50 < len(thinning.poses) <= 100
    assert thinning.is_capped
    assert set(campaign.poses.artefacts[thinning.poses]) == {0, 1, 2, 3}


def test_speeds_and_senses_are_those_of_the_motion():
    scan = simulate_scan(seven_joint_arm(), scan_file(), 5)
    usual = np.sqrt(np.mean(scan.around.speed_rad_s**2))
    stretches = stretches_of(scan.around.time_s)
    assert np.all(stretches == 0)
    speeds = speeds_of(scan.around.time_s, scan.readings_rad, stretches)
    known = np.isfinite(speeds[:, 0])
    assert np.count_nonzero(~known) == 8
    misses = (speeds - scan.around.speed_rad_s)[known]
    assert np.sqrt(np.mean(misses**2)) < 0.05 * usual
    senses = senses_of(scan.around.time_s, scan.readings_rad, speeds)
    fast = np.abs(scan.around.speed_rad_s) > 0.05
    right = (senses == np.sign(scan.around.speed_rad_s))[fast & known[:, None]]
    assert np.mean(right) > 0.999


def test_harmonics_of_all_samples_are_those_of_the_dense_algebra(folders):
    arm, campaign = read(folders(LATENCY, BACKLASH))
    few = campaign.part(np.arange(0, len(campaign.poses), 24))
    fit = fitted(few, arm, np.ones(len(few.poses), dtype=bool))
    included = few.part(fit.included)
    rows = equations_of(
        replace(
            fit.adjustment,
            state=replace(
                fit.adjustment.state,
                corrections=tuple(np.zeros_like(c) for c in _corrections(fit)),
            ),
        )
    )
    harmonics = stream_harmonics(rows, included)
    by_name = {harmonic.candidate.name: harmonic for harmonic in harmonics}
    dense = judge(rows, project(rows, harmonic_bank(rows)))
    ratios, amplitudes = [], []
    for harmonic, statistic in zip(dense.projected, dense.statistics, strict=True):
        if len(harmonic.singular_values) < 2 or harmonic.singular_values.min() < 1.0:
            continue
        other = by_name[harmonic.candidate.name]
        ratios.append((harmonic.candidate.order or 1, other.statistic / statistic))
        amplitudes.append(
            (other.amplitudes_rad, harmonic.amplitudes(rows.residuals)[0])
        )
    orders, quotients = np.array(ratios).T
    assert len(orders) > 300
    # One excess for each order; joints agree.
    for order in np.unique(orders):
        assert np.ptp(quotients[orders == order]) < 1e-5
    ours, theirs = np.array(amplitudes).swapaxes(0, 1)
    assert np.allclose(ours, theirs, rtol=1e-5, atol=1e-12)


def _corrections(fit):
    return fit.adjustment.state.corrections


def test_a_small_high_harmonic_shows_in_all_samples(tmp_path):
    table = {"kind": "encoder_harmonic", "joint": "J1", "order": 17}
    effect = effect_from_table({**table, "cos_rad": 2e-6, "sin_rad": 0.0})
    hidden = seven_joint_arm().model_copy(update={"effects": (effect,)})
    write_scan(tmp_path, simulate_scan(hidden, scan_file(), 8), 8)
    arm, campaign = read(tmp_path)
    diagnosis = diagnose_stream(campaign, arm, OPTIONS)
    # The poses alone do not show it.
    assert diagnosis.n_from_stream == 1
    (term,) = diagnosis.diagnosis.terms
    assert term.candidate.name == "encoder_harmonic 17 J1"
    assert term.status == diagnosis.diagnosis.verdict == "named"
    assert term.accepted
    estimate = term.parameters["cos_rad"]
    assert abs(estimate.value - 2e-6) < 4.0 * estimate.std
    (written,) = diagnosis.diagnosis.adapted.effects
    assert written.values["order"] == 17
    assert diagnosis.diagnosis.arm.effects == ()
    assert [step.effect for step in diagnosis.diagnosis.ledger] == [
        None,
        "encoder_harmonic 17 J1",
    ]
    # What is left is no more than chance.
    assert first_significant(diagnosis.harmonics, 1e-3) is None


def with_late_joint(campaign, joint, n_samples):
    """Shift a joint's readings, and the speeds that they show, to later samples."""
    poses = campaign.poses
    lines = poses.lines[n_samples:] - n_samples
    kept = np.flatnonzero(lines == poses.lines[:-n_samples])
    angles_rad, speeds = poses.angles_rad.copy(), poses.speeds_rad_s.copy()
    for column in (angles_rad, speeds):
        column[n_samples:, joint] = column[:-n_samples, joint].copy()
    late = replace(poses, angles_rad=angles_rad, speeds_rad_s=speeds)
    return replace(campaign, poses=late).part(n_samples + kept)


def test_a_reading_that_is_late_by_samples_is_that_joints_latency_alone(folders):
    arm, campaign = read(folders())
    late = with_late_joint(campaign, joint=3, n_samples=3)
    thinned, thinning = decimated(late, arm, most_poses=600)
    poses = thinned.part(thinning.poses)
    diagnosis = diagnose(poses, arm, OPTIONS)
    (term,) = diagnosis.terms
    assert term.candidate.name == "encoder_latency J4"
    assert diagnosis.verdict == "named"
    assert term.parameters["latency_s"].value == pytest.approx(0.015, abs=2e-5)
    assert not diagnosis.after.network.holds_scale


def test_an_arm_that_would_shrink_to_a_point_keeps_its_scale(folders):
    """A point is on every cone and on a sphere; with a joint turned round no arm is."""
    arm, campaign = read(folders())
    few = campaign.part(np.arange(0, len(campaign.poses), 60))
    angles_rad = few.poses.angles_rad * np.array([1, 1, 1, -1, 1, -1, 1])
    wrong = few.with_poses(angles_rad=angles_rad)
    fit = fitted(wrong, arm, np.ones(len(few.poses), dtype=bool))
    assert fit.adjustment.network.holds_scale
    assert fit.size > 0.8


def test_speeds_since_the_instant_of_a_reading_turn_it_into_the_angle():
    """Of motions in sines, whose angles are known at every instant."""
    campaign = stream_of_sines(late_s=0.013)
    stretches = np.zeros(len(campaign.poses), dtype=np.int64)
    late_s = np.array([0.0, 0.013, 0.0, 0.0, 0.0, 0.0, 0.0])
    led = with_speeds_since(campaign, stretches, late_s)
    assert len(led.poses) == len(campaign.poses) - 3
    for poses, is_exact in ((led.poses, True), (campaign.poses, False)):
        corrected_rad = poses.angles_rad[:, 1] + 0.013 * poses.speeds_rad_s[:, 1]
        errors_rad = corrected_rad - 0.8 * np.sin(3.0 * poses.time_s)
        assert (np.max(np.abs(errors_rad)) < 1e-6) == is_exact
        assert np.max(np.abs(errors_rad)) < 1e-3
    before, after = campaign.poses.speeds_rad_s, led.poses.speeds_rad_s
    assert np.array_equal(after[:, 0], before[:-3, 0])


def stream_of_sines(late_s):
    arm = seven_joint_arm()
    time_s = np.arange(400) / 200.0
    shown_s = np.zeros((400, len(arm.joints)))
    shown_s[:, 1] = time_s - late_s
    campaign = campaign_of_places(
        [joint.name for joint in arm.joints],
        0.8 * np.sin(3.0 * shown_s),
        np.zeros((400, 3)),
    )
    speeds_rad_s = 2.4 * np.cos(3.0 * shown_s)
    return campaign.with_poses(time_s=time_s, speeds_rad_s=speeds_rad_s)
