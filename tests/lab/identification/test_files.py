"""A campaign folder in, an arm with its covariance and figures out."""

import csv
import hashlib
import json
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from tests.lab.simulated import DESIGN, DESIGN_ARM, bar, built, cones, simulate, written
from traverse.kinematics.arm_file.arm import geometry_digest, read_arm
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.lab.campaign.campaign import read_campaign
from traverse.lab.identification.identify import Options, identify
from traverse.lab.identification.results.files import (
    identification_json,
    identified_arm,
    write_result,
)

NAMES = [f"J{k}" for k in range(1, 8)]
WHEN = datetime(2026, 11, 21, 8, 0, tzinfo=UTC)
NET = {
    "id": "net",
    "kind": "points",
    "frame": "own",
    "points_mm": {"A": [0.0, 0, 0], "B": [200.0, 0, 0], "C": [0.0, 150, 60]},
}


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    campaign = simulate(built(1), [*cones(2), bar(), NET], 40, 5)
    angles = campaign.poses.angles_rad
    angles[17] += 1e-3
    source = written(campaign, tmp_path_factory.mktemp("campaign"))
    result = identify(read_campaign(source, NAMES), DESIGN_ARM)
    target = tmp_path_factory.mktemp("out") / "deep"
    arm = write_result(result, target, WHEN)
    return result, arm, target, campaign


def test_the_files_of_a_campaign_give_the_same_as_its_arrays(folders):
    result, _, _, campaign = folders
    direct = identify(campaign, DESIGN_ARM)
    assert result.sigma0 == direct.sigma0
    assert result.arm.joints == direct.arm.joints


def test_the_arm_states_at_which_temperatures_it_was_identified(folders):
    result, arm, _, campaign = folders
    assert arm.identification.temperature_low_c is None
    temperature_c = np.linspace(19.5, 22.0, len(campaign.poses.time_s))
    temperature_c[3] = np.nan
    warm = replace(result, campaign=campaign.with_poses(temperature_c=temperature_c))
    known = identified_arm(warm, WHEN, "").identification
    assert (known.temperature_low_c, known.temperature_high_c) == (19.5, 22.0)


def test_the_arm_is_written_with_its_provenance(folders):
    result, arm, target, _ = folders
    read = read_arm(target / "arm.toml")
    assert read == arm
    assert read.identification.sigma0 == result.sigma0
    assert read.identification.redundancy == result.redundancy
    assert read.identification.date == WHEN
    assert read.identification.campaign_digest == result.campaign.digest
    assert len(read.identification.parameters) == 25
    content = (target / read.identification.covariance_file).read_bytes()
    assert read.identification.covariance_digest == hashlib.sha256(content).hexdigest()
    assert read.identification.arm_digest == geometry_digest(read)
    geometry = geometry_from_arm(read)
    assert np.allclose(geometry.axes, result.adjustment.state.arm.geometry.axes)
    assert read.probe == DESIGN_ARM.probe


def test_the_covariance_is_over_components_and_free_of_any_basis(folders):
    result, arm, target, _ = folders
    with np.load(target / "arm.cov.npz") as file:
        names = file["names"].tolist()
        covariance, values = file["covariance"], file["values"]
    assert names[:4] == ["J1.axis.x", "J1.axis.y", "J1.axis.z", "J2.axis.x"]
    assert names[21] == "J1.link.x"
    assert names[42:45] == ["probe.vector.x", "probe.vector.y", "probe.vector.z"]
    assert covariance.shape == (48, 48)
    assert np.allclose(covariance, covariance.T, atol=0)
    assert np.linalg.matrix_rank(covariance, tol=1e-18) == 25
    for k, joint in enumerate(arm.joints):
        of_joint = slice(3 * k, 3 * k + 3)
        assert values[of_joint].tolist() == list(joint.axis)
        # No axis varies along itself.
        assert np.allclose(covariance[of_joint].T @ np.array(joint.axis), 0, atol=1e-12)
    trace = np.trace(covariance[:21, :21])
    stds = [entry.std for entry in result.parameters if ".axis." in entry.name]
    assert trace == pytest.approx(np.sum(np.square(stds)))


def test_identification_json_follows_the_contract(folders):
    result, _, target, _ = folders
    values = json.loads((target / "identification.json").read_text())
    provenance = values.pop("provenance")
    assert provenance["campaign"]["sha256"] == result.campaign.digest
    assert set(provenance["versions"]) == {"Traverse", "Python", "numpy"}
    again = json.loads(json.dumps(identification_json(result)))
    assert values == {key: again[key] for key in again if key != "provenance"}
    assert values["schema"] == "traverse/identification/1"
    assert values["converged"] is True
    assert isinstance(values["iterations"], int)
    assert set(values["global_test"]) >= {"p_value", "passed"}
    assert values["rms_mm"]["after"] < 0.01 < values["rms_mm"]["before"]
    parameter = values["parameters"][0]
    assert set(parameter) == {"name", "value", "unit", "std", "controllability"}
    assert 0.0 < parameter["controllability"] <= 1.0
    assert values["undetermined"] == []
    cone, net = values["artefacts"]["cone-0"], values["artefacts"]["net"]
    assert cone.keys() == {"n", "rms_mm", "n_all", "rms_all_mm", "place"}
    hurt = [a for a in values["artefacts"].values() if a["n_all"] > a["n"]]
    assert [
        (a["n_all"] - a["n"], a["rms_all_mm"] > 2.0 * a["rms_mm"]) for a in hurt
    ] == [(1, True)]
    assert net["mean_distance_all_mm"] >= net["mean_distance_mm"]
    distance = values["artefacts"]["bar"]["distance_mm"]
    assert distance["value"] == pytest.approx(400.0, abs=5 * distance["std"])
    assert values["artefacts"]["net"]["mean_distance_mm"] > 0
    assert [entry["line"] for entry in values["excluded"]] == [19]
    assert values["excluded"][0]["w"] > 10


def test_a_residual_a_line_of_the_campaign(folders):
    result, _, target, _ = folders
    with (target / "residuals.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["line"]) for row in rows] == list(range(2, 162))
    assert [row["line"] for row in rows if row["excluded"] == "1"] == ["19"]
    on_bar = [row for row in rows if row["artefact"] == "bar"]
    assert all(row["w1_mm"] and not row["w2_mm"] for row in on_bar)
    squares = [
        float(row[name]) ** 2
        for row in rows
        if row["excluded"] == "0"
        for name in ("w1_mm", "w2_mm", "w3_mm")
        if row[name]
    ]
    assert np.sqrt(np.mean(squares)) == pytest.approx(result.rms_after_mm, rel=1e-3)


def test_readings_are_corrected_by_about_their_noise(folders):
    result, *_ = folders
    corrections = result.statistics.corrections_rad[result.included]
    assert 1e-7 < np.sqrt(np.mean(corrections**2)) < 5e-6


def test_iterations_are_reported_as_they_happen():
    campaign = simulate(built(1), [*cones(2), bar()], 30, 5)
    iterations = []
    result = identify(campaign, DESIGN_ARM, Options(), iterations.append)
    assert tuple(iterations) == result.iterations
    assert iterations[0].number == 1
    assert iterations[-1].step < 1e-6
    assert iterations[0].rms_mm == pytest.approx(result.rms_before_mm, rel=1e-9)
    assert iterations[-1].rms_mm == pytest.approx(result.rms_after_mm, rel=1e-3)


def test_an_own_certificate_is_left_out_of_what_the_arm_measures():
    wrong = simulate(built(1), [*cones(2), bar(), bar(id="other")], 60, 5)
    # The second certificate is wrong by a tenth of a millimetre.
    other = wrong.artefacts[3].model_copy(
        update={"distance_mm": 400.1, "distance_std_mm": 0.5}
    )
    campaign = wrong.__class__(
        (*wrong.artefacts[:3], other),
        wrong.feature_names,
        wrong.joint_names,
        wrong.poses,
        encoder_rad=5e-6,
        contact_mm=0.005,
    )
    result = identify(campaign, DESIGN_ARM, Options(snooping=False))
    length = result.artefacts[3].lengths[0]
    assert length.value_mm == pytest.approx(400.0, abs=5 * length.std_mm)
    assert length.std_mm < 0.02
    alone = (
        identify(simulate(DESIGN, [*cones(2), bar()], 30, 1), DESIGN_ARM)
        .artefacts[2]
        .lengths[0]
    )
    assert alone.value_mm == pytest.approx(400.0, abs=0.1)
