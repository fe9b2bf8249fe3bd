"""What a diagnosis writes: arm file, diagnosis.json to the letter, pictures."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.lab.diagnosis.diagnosed import (
    COMMENT,
    COS_RAD,
    SIN_RAD,
    WHEN,
    clean,
    drifting,
    eccentric,
    write_source,
    written_files,
)
from traverse.kinematics.arm_file.arm import geometry_digest, read_arm, write_arm
from traverse.lab.diagnosis.report.files import (
    accept_adapted,
    arm_with_provenance,
    pose_parts,
    write_diagnosis,
)
from traverse.lab.diagnosis.report.outcome import diagnosis_json
from traverse.lab.outcomes.diagnosis import HoldoutResult

FILES = {
    "arm.toml",
    "arm.cov.npz",
    "diagnosis.json",
    "discrepancies.csv",
    "report.html",
    "ledger.png",
    "artefacts.png",
    "joints.png",
    "conditions.png",
    "term-1.png",
}


@pytest.fixture(scope="module")
def source(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("arms") / "bench.toml"
    write_source(path)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    target = tmp_path_factory.mktemp("out") / "deep"
    target.mkdir()
    for name, content in written_files().items():
        (target / name).write_bytes(content)
    return target


@pytest.fixture(scope="module")
def written(folder) -> Any:
    return json.loads((folder / "diagnosis.json").read_text("utf-8"))


def test_just_these_files_are_written(folder):
    assert {path.name for path in folder.iterdir()} == FILES
    for name in FILES:
        if name.endswith(".png"):
            assert (folder / name).read_bytes().startswith(b"\x89PNG")


def test_the_arm_has_the_effect_its_provenance_and_the_comments(folder, source):
    arm = read_arm(folder / "arm.toml")
    assert (folder / "arm.toml").read_text("utf-8").startswith(COMMENT)
    assert source.read_text("utf-8").count("[[effects]]") == 0
    (effect,) = arm.effects
    assert (effect.kind, effect.joint) == ("encoder_eccentricity", "J3")
    (term,) = eccentric().terms
    for key, truth_rad in (("cos_rad", COS_RAD), ("sin_rad", SIN_RAD)):
        std_rad = term.parameters[key].std
        assert effect.values[key] == pytest.approx(truth_rad, abs=4 * std_rad)
    assert arm.identification.date == WHEN
    assert arm.identification.sigma0 == eccentric().after.sigma0
    assert "J3.encoder_eccentricity.cos_rad" in arm.identification.parameters


def test_an_arm_file_can_be_written_in_place(folder, source, tmp_path):
    path = tmp_path / "bench.toml"
    path.write_bytes(source.read_bytes())
    accept_adapted(path, read_arm(folder / "arm.toml"), folder)
    for name, beside in (("arm.toml", path.name), ("arm.cov.npz", "arm.cov.npz")):
        written = (tmp_path / beside).read_bytes()
        assert written == (folder / name).read_bytes()


def test_the_covariance_is_that_of_what_was_estimated(folder):
    diagnosis = eccentric()
    arm = read_arm(folder / "arm.toml")
    stored = np.load(folder / "arm.cov.npz")
    digest = hashlib.sha256((folder / "arm.cov.npz").read_bytes()).hexdigest()
    assert arm.identification.covariance_digest == digest
    assert arm.identification.arm_digest == geometry_digest(arm)
    names = stored["names"].tolist()
    (term,) = diagnosis.terms
    for key in ("cos_rad", "sin_rad"):
        at = names.index(f"J3.encoder_eccentricity.{key}")
        assert stored["values"][at] == arm.effects[0].values[key]
        std_rad = np.sqrt(stored["covariance"][at, at])
        assert std_rad == pytest.approx(term.parameters[key].std, rel=0.1)


def test_the_json_follows_the_contract(written):
    assert written["schema"] == "traverse/diagnosis/1"
    assert written["verdict"] == "named"
    (term,) = written["terms"]
    assert term["status"] == "named"
    assert (term["kind"], term["joint"]) == ("encoder_eccentricity", "J3")
    assert term["order"] is None
    assert term["component"] is None
    assert term["covariate"] is None
    assert "harmonic" not in term
    assert set(term["parameters"]) == {"cos_rad", "sin_rad"}
    assert set(term["parameters"]["cos_rad"]) == {"value", "std", "unit"}
    assert term["log_bayes_factor"] > 20
    assert np.log10(term["p_value"]) == pytest.approx(term["log10_p"])
    assert isinstance(term["separate_by"], str)
    for rival in term["alternatives"]:
        assert rival.keys() >= {"kind", "joint", "order", "log_bayes_factor", "alias"}
    assert written["sigma0"]["after"] < written["sigma0"]["before"]
    gap = written["gap"]
    for key in ("held_out_rms_mm", "held_out_chi2"):
        assert gap[key]["after"] < gap[key]["before"]
    assert 0.5 < gap["closed"] < 1.2
    assert "held_out_mean_distance_mm" not in gap
    blunder = int(eccentric().campaign.poses.lines[100])
    (excluded,) = written["excluded"]
    assert excluded["line"] == blunder
    assert (excluded["choosing"], excluded["final"]) == (True, True)
    assert excluded["w"] > 10.0
    assert (written["state"], written["reasons"]) == ("good", [])
    assert [step["effect"] for step in written["ledger"]] == [
        None,
        "encoder_eccentricity J3",
    ]
    assert written["ledger"][0]["held_out_rms_mm"] == gap["held_out_rms_mm"]["before"]
    assert written["ledger"][1]["held_out_rms_mm"] == gap["held_out_rms_mm"]["after"]
    for entry in written["detectable"]:
        assert entry.keys() >= {"kind", "joint", "minimum"}
        minimum = entry["minimum"]
        assert minimum is None or minimum.keys() == {"value", "unit"}
        assert (minimum is None) == bool(entry["why"])


def test_a_p_value_below_all_numbers_is_zero_beside_its_logarithm():
    diagnosis = eccentric()
    term = replace(diagnosis.terms[0], log10_p=-1234.5)
    (values,) = diagnosis_json(replace(diagnosis, terms=(term,)))["terms"]
    assert values["p_value"] == 0.0
    assert values["log10_p"] == -1234.5


def test_a_gap_that_cannot_be_told_is_null():
    diagnosis = eccentric()
    untold = replace(
        diagnosis,
        gap=replace(diagnosis.gap, before=replace(diagnosis.gap.before, chi2=1.0)),
    )
    assert diagnosis_json(untold)["gap"]["closed"] is None


def test_known_points_have_a_mean_distance():
    gap = replace(
        eccentric().gap,
        before=HoldoutResult(0.02, 3.0, 90, 0.031),
        after=HoldoutResult(0.01, 1.0, 90, 0.015),
    )
    values = diagnosis_json(replace(eccentric(), gap=gap))["gap"]
    assert values["held_out_mean_distance_mm"] == {"before": 0.031, "after": 0.015}


def test_clean_has_no_terms():
    values = diagnosis_json(clean())
    assert values["verdict"] == "clean"
    assert values["terms"] == []
    assert len(values["ledger"]) == 1
    json.dumps(values, allow_nan=False)


@pytest.mark.slow
def test_an_effect_bound_to_an_unknown_time_is_not_written(tmp_path):
    diagnosis = drifting()
    source = tmp_path / "bench.toml"
    write_arm(source, diagnosis.arm)
    assert [effect.kind for effect in diagnosis.adapted.effects] == ["base_drift"]
    write_diagnosis(tmp_path / "out", diagnosis, source, WHEN)
    arm = read_arm(tmp_path / "out" / "arm.toml")
    assert arm.effects == ()
    assert not any("base_drift" in name for name in arm.identification.parameters)
    values = json.loads((tmp_path / "out" / "diagnosis.json").read_text("utf-8"))
    assert values["terms"][0]["accepted"]
    assert not values["terms"][0]["in_arm_file"]
    # With a start it has an epoch, and is written.
    started = replace(diagnosis, campaign=replace(diagnosis.campaign, start_utc=WHEN))
    assert len(arm_with_provenance(started).effects) == 1


def test_every_pose_has_one_part(folder):
    diagnosis = eccentric()
    parts = pose_parts(diagnosis)
    assert parts[100] == "excluded"
    assert parts.count("held_out") == np.count_nonzero(
        diagnosis.held_out & ~diagnosis.excluded
    )
    assert set(parts) == {"choosing", "held_out", "excluded"}
