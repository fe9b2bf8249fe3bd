import json
import shutil

import numpy as np
import pytest

from tests.lab.simulated import Noise, arm_value, cones, seven_joints, simulate, written
from tests.running import invoke
from traverse.daemon.pose.probe_library import read_probes
from traverse.kinematics.arm_file.arm import effect_from_table, read_arm, write_arm

VECTOR_MM = (12.0, -5.0, 60.0)
LIBRARY = """\
schema = "traverse/probes/1"

[[probes]]
name = "ball-6"                        # the usual one
radius_mm = 3.0
vector_mm = {vector}
direction = [0.0, 0.0, 1.0]
kind = "hard"

[[probes]]
name = "other"
radius_mm = 1.0
vector_mm = [0.0, 0.0, 10.0]
direction = [0.0, 0.0, 1.0]
kind = "hard"
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """An arm whose probe truly is VECTOR_MM, and poses of it in two cones."""
    folder = tmp_path_factory.mktemp("pivot")
    true = seven_joints()
    arm = arm_value(true)
    # The simulated arm has its ball at the end of the last link.
    last = arm.joints[-1]
    shorter = tuple(np.subtract(last.link_mm, VECTOR_MM).tolist())
    joints = (*arm.joints[:-1], last.model_copy(update={"link_mm": shorter}))
    changes = {
        "joints": joints,
        "probe": arm.probe.model_copy(update={"vector_mm": VECTOR_MM}),
    }
    write_arm(folder / "arm.toml", arm.model_copy(update=changes))
    noise = Noise(encoder_rad=2e-6, contact_mm=0.002)
    written(simulate(true, cones(2), 25, 5, noise=noise), folder)
    return folder


def library(folder, vector=VECTOR_MM):
    path = folder / "probes.toml"
    path.write_text(LIBRARY.format(vector=list(vector)))
    return path


def run(bench, *options, typed=None, status=0):
    base = ["probe", "pivot", str(bench), "--arm", str(bench / "arm.toml")]
    return invoke(*base, *options, input=typed, status=status)


def test_the_vector_is_found_within_its_uncertainty(bench):
    done = run(bench, "--cone", "cone-0", "--json")
    report = json.loads(done.stdout)
    assert report["vector_mm"] == pytest.approx(VECTOR_MM, abs=0.02)
    assert report["off_sigma"] < 4.0
    assert report["redundancy"] == 3 * 25 - 6
    assert 0.001 < report["rms_mm"] < 0.02
    assert max(report["std_mm"]) < 0.01


def test_a_change_beyond_the_limit_is_not_taken_unasked(bench, tmp_path):
    path = library(tmp_path, (12.0, -4.8, 60.0))
    before = path.read_text()
    options = ("--cone", "cone-1", "--library", path, "--name", "ball-6")
    done = run(bench, *options, "--write", status=1)
    assert "off by 0.2" in done.stdout
    assert "more than 0.05 mm" in done.stderr
    assert path.read_text() == before
    run(bench, *options, "--limit-mm", 0.5)


def test_what_was_found_goes_into_the_library_and_comments_stay(bench, tmp_path):
    path = library(tmp_path, (12.0, -4.8, 60.0))
    options = ("--cone", "cone-1", "--library", path, "--name", "ball-6")
    run(bench, *options, "--write", "--yes")
    assert "# the usual one" in path.read_text()
    stored = read_probes(path)
    assert stored.named("ball-6").vector_mm == pytest.approx(VECTOR_MM, abs=0.02)
    assert stored.named("ball-6").covariance_mm2.shape == (3, 3)
    assert stored.named("ball-6").date is not None
    assert stored.named("other").vector_mm == (0.0, 0.0, 10.0)
    assert stored.named("other").date is None
    run(bench, *options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "name one with --cone"),
        (["--cone", "cone-7"], "no cone 'cone-7'; it has: cone-0, cone-1"),
        (["--name", "ball-6"], "go together"),
        (["--write"], "--write needs"),
    ],
)
def test_what_cannot_be_done_is_refused(bench, options, message):
    done = run(bench, *options, status=2)
    assert message in done.stderr


def test_a_probe_that_is_not_in_the_library_is_refused(bench, tmp_path):
    path = library(tmp_path)
    done = run(bench, "--cone", "cone-0", "--library", path, "--name", "long", status=2)
    assert "it has: ball-6, other" in done.stderr


def check_like_plain(bench, folder):
    """With the effect of this folder's arm the vector equals the plain arm's."""
    shutil.copy(bench / "campaign.toml", folder)
    with_effect = run(folder, "--cone", "cone-0", "--json")
    plain = run(bench, "--cone", "cone-0", "--json")
    vectors = [json.loads(done.stdout)["vector_mm"] for done in (with_effect, plain)]
    assert vectors[0] == pytest.approx(vectors[1], abs=1e-6)


def test_effects_of_the_readings_are_taken_out(bench, tmp_path):
    """With an eccentricity in the file and the same in the readings nothing changes."""
    arm = read_arm(bench / "arm.toml")
    table = {"kind": "encoder_eccentricity", "joint": "J3"}
    off = effect_from_table({**table, "cos_rad": 1e-3, "sin_rad": -5e-4})
    write_arm(tmp_path / "arm.toml", arm.model_copy(update={"effects": (off,)}))
    header, *rows = (bench / "poses.csv").read_text().splitlines()
    column = header.split(",").index("J3_rad")
    changed = [header]
    for row in rows:
        cells = row.split(",")
        true = seen = float(cells[column])
        for _ in range(50):  # solve for the reading whose correction is the true angle
            seen = true + 1e-3 * np.cos(seen) - 5e-4 * np.sin(seen)
        cells[column] = repr(float(seen))
        changed.append(",".join(cells))
    (tmp_path / "poses.csv").write_text("\n".join(changed) + "\n")
    check_like_plain(bench, tmp_path)


def test_effects_of_the_links_are_taken_out(bench, tmp_path):
    """Shorter links that are warm are the links of the plain arm."""
    arm = read_arm(bench / "arm.toml")
    warm_c = arm.reference.temperature_c + 10.0
    off = effect_from_table({"kind": "thermal_expansion", "expansion_per_c": 2e-4})
    joints = tuple(
        joint.model_copy(
            update={"link_mm": tuple(r / (1 + 2e-3) for r in joint.link_mm)}
        )
        for joint in arm.joints
    )
    changes = {"effects": (off,), "joints": joints}
    write_arm(tmp_path / "arm.toml", arm.model_copy(update=changes))
    header, *rows = (bench / "poses.csv").read_text().splitlines()
    assert "temperature_c" not in header
    warm = [f"{header},temperature_c", *(f"{row},{warm_c}" for row in rows)]
    (tmp_path / "poses.csv").write_text("\n".join(warm) + "\n")
    check_like_plain(bench, tmp_path)
