"""Simulated dense scans: the ball stays where it should, effects are played."""

import numpy as np
import pytest

from tests.simulator.campaigns.arms import ball_centres_mm, seven_joint_arm
from traverse.kinematics.arm_file.arm import effect_from_table, write_arm
from traverse.recording.reader import read_recording
from traverse.simulator.campaigns.dense.__main__ import main
from traverse.simulator.campaigns.dense.scan import NOTHING, simulate_scan
from traverse.simulator.campaigns.dense.spec import DenseFile
from traverse.simulator.campaigns.dense.writing import write_scan

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


def spec_file(**more):
    ball = {"id": "ball", "kind": "sphere", "radius_mm": 25.0, "n_poses": 2}
    return DenseFile.model_validate(
        {
            "schema": "traverse/simulated-campaign/1",
            "arm": "arm.toml",
            "deviations": {"links_mm": 0.0, "axes_rad": 0.0, "zeros_rad": 0.0},
            "noise": {"encoder_rad": 0.0, "contact_mm": 0.0},
            "scan": {"rate_hz": 100.0, "seconds": 2.0},
            "artefacts": ({"id": "seat", "kind": "cone", "n_poses": 1}, ball),
            **more,
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
    found = simulate_scan(arm, spec_file(), 3)
    errors = found.readings_rad - plain.readings_rad
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
        found = np.mean(errors[lag:] * errors[:-lag]) / np.mean(errors**2)
        assert found == pytest.approx(0.5 * 0.8**lag, abs=0.08)


def test_the_file_holds_the_counts(plain, tmp_path):
    write_scan(tmp_path, plain, 3)
    found = read_recording(tmp_path / "scan.mcap")
    assert np.array_equal(found.samples.counts, plain.counts)
    for joint, part in enumerate(plain.arm.joints):
        step_rad = part.encoder.sign * 2.0 * np.pi / part.encoder.counts_per_turn
        off_rad = (
            plain.readings_rad[:, joint] - step_rad * found.samples.counts[:, joint]
        )
        turns = off_rad / (2.0 * np.pi)
        assert np.max(np.abs(turns - np.round(turns))) * 2.0 * np.pi < abs(step_rad)
    assert [t.artefact for t in found.touching] == ["seat", None, "ball", None, "ball"]
    assert np.all(found.samples.received_ns > found.samples.sample_time_ns)
    assert (found.campaign_text or "").count("[[artefacts]]") == 2


def test_the_command_makes_a_folder(tmp_path, capsys):
    (tmp_path / "spec.toml").write_text(SPEC)
    write_arm(tmp_path / "arm.toml", seven_joint_arm())
    out = tmp_path / "out"
    assert main([str(tmp_path / "spec.toml"), "--out", str(out), "--seed", "4"]) == 0
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
    arguments = [str(tmp_path / "spec.toml"), "--out", str(tmp_path / "out")]
    assert main(arguments) == 2
    assert words in capsys.readouterr().err
