"""Several markers on one flange, against an arm of matrices with another last link."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from tests.lab.simulated import (
    Noise,
    arm_value,
    built,
    disturbed,
    rotations,
    simulate,
    written,
)
from tests.running import invoke
from traverse.lab.campaign.campaign_file import Tool
from traverse.lab.diagnosis.diagnose import DiagnosisOptions, diagnose
from traverse.lab.diagnosis.report.files import write_diagnosis
from traverse.lab.identification.identify import Options, identify
from traverse.lab.identification.prediction import placed, places_of, predict
from traverse.strict_toml.rewriting import rewritten_text

OFFSETS_MM = {
    "low": np.array([12.0, -35.0, 20.0]),
    "far": np.array([300.0, -200.0, 250.0]),
}
GRID = {"A": [0.0, 0, 0], "B": [90.0, 0, 0], "C": [0.0, 80, 0], "D": [10.0, 20, 70]}
TABLES = [
    {"id": "grid", "kind": "points", "frame": "own", "points_mm": GRID},
    {"id": "cone-0", "kind": "cone", "place_mm": (450.0, 380.0, 200.0)},
    {"id": "cone-1", "kind": "cone", "place_mm": (-200.0, 560.0, 100.0)},
]
TRUE = built(3)
QUICK = Options(n_suggestions=0)
RARE = 1e-3


def measured(names, n_each=40, noise=None):
    """Measure the same artefacts with several tools; "" is the arm's own."""
    parts = []
    for name in names:
        links_mm = TRUE.links_mm.copy()
        links_mm[-1] += OFFSETS_MM.get(name, 0.0)
        arm = replace(TRUE, links_mm=links_mm)
        parts.append(simulate(arm, TABLES, n_each, 5, noise=noise, travel_rad=2.5))
    order = list(OFFSETS_MM)
    numbers = [order.index(name) + 1 if name else 0 for name in names]
    n = len(parts[0].poses)
    columns = {
        column: np.concatenate([getattr(part.poses, column) for part in parts])
        for column in ("artefacts", "features", "angles_rad")
    }
    poses = replace(
        parts[0].poses,
        **columns,
        lines=np.arange(2, n * len(names) + 2),
        time_s=np.arange(float(n * len(names))),
        tools=np.repeat(numbers, n),
    )
    return replace(
        parts[0], poses=poses, tools=tuple(Tool(name=name) for name in order)
    )


@pytest.fixture(scope="module")
def campaign():
    return measured(["", "low", "far"])


def off_by_sigmas(result, name, expected_mm):
    names = [f"tool.{name}.{axis}" for axis in "xyz"]
    at = [
        [parameter.name for parameter in result.parameters].index(each)
        for each in names
    ]
    miss_mm = result.tools_mm[name] - expected_mm
    return miss_mm @ np.linalg.solve(result.covariance[np.ix_(at, at)], miss_mm)


def test_vectors_of_tools_are_estimated_with_the_arm(campaign):
    result = identify(campaign, arm_value(disturbed(TRUE, seed=8)), QUICK)
    assert result.converged
    assert result.excluded == ()
    assert result.undetermined == ()
    low, high = chi2.ppf([RARE, 1 - RARE], result.redundancy)
    assert low < result.sigma0**2 * result.redundancy < high
    # In the base posture of the estimated arm, which is turned a little.
    for name, offset_mm in OFFSETS_MM.items():
        assert np.linalg.norm(result.tools_mm[name]) == pytest.approx(
            np.linalg.norm(offset_mm), abs=0.05
        )


def test_poses_with_the_name_of_another_tool_are_left_out_alone(campaign):
    tools, wrong = campaign.poses.tools.copy(), np.array([3, 50, 130, 200, 300])
    tools[wrong] = (tools[wrong] + 1) % 3
    named = campaign.with_poses(tools=tools)
    result = identify(named, arm_value(disturbed(TRUE, seed=8)), QUICK)
    assert [pose.line for pose in result.excluded] == (wrong + 2).tolist()
    assert result.global_test.passed


def test_with_the_arm_held_they_are_those_of_linear_least_squares():
    """x_i + P_i d = c of every pose, by matrices and `lstsq`."""
    campaign = measured(["", "low"], noise=Noise(0.0, 0.005))
    campaign = replace(campaign, encoder_rad=1e-12).part(campaign.poses.artefacts > 0)
    hold = ("*.axis.?", "*.link.?")
    result = identify(campaign, arm_value(TRUE), replace(QUICK, hold=hold))
    angles_rad, n = campaign.poses.angles_rad, len(campaign.poses)
    turned = np.broadcast_to(np.eye(3), (n, 3, 3))
    for k, axis in enumerate(TRUE.axes):
        turned = turned @ rotations(axis, angles_rad[:, k] - TRUE.zeros_rad[k])
    has_tool = (campaign.poses.tools == 1)[:, None, None]
    seats = np.zeros((n, 3, 6))
    for seat in range(2):
        seats[
            campaign.poses.artefacts == seat + 1, :, 3 * seat : 3 * seat + 3
        ] = -np.eye(3)
    rows = np.concatenate([turned * has_tool, seats], axis=2).reshape(-1, 9)
    solved = np.linalg.lstsq(rows, -TRUE.centres(angles_rad).ravel(), rcond=None)[0]
    np.testing.assert_allclose(result.tools_mm["low"], solved[:3], atol=1e-6)
    covariance = 0.005**2 * np.linalg.inv(rows.T @ rows)[:3, :3]
    stds_mm = result.tools["low"]["std_mm"]
    np.testing.assert_allclose(stds_mm, np.sqrt(np.diag(covariance)), rtol=1e-4)
    assert off_by_sigmas(result, "low", OFFSETS_MM["low"]) < chi2.ppf(1 - RARE, 3)


def test_without_the_arms_own_probe_the_first_tool_is_held():
    campaign = measured(["low", "far"])
    result = identify(campaign, arm_value(TRUE), QUICK)
    assert result.converged
    assert result.undetermined == ()
    np.testing.assert_array_equal(result.tools_mm["low"], np.zeros(3))
    assert result.tools["low"]["std_mm"] == [None] * 3
    between_mm = np.linalg.norm(OFFSETS_MM["far"] - OFFSETS_MM["low"])
    assert np.linalg.norm(result.tools_mm["far"]) == pytest.approx(between_mm, abs=0.05)


def test_tools_that_are_held_count_as_known(campaign):
    known = campaign.with_tools(OFFSETS_MM)
    result = identify(known, arm_value(TRUE), QUICK)
    low, high = chi2.ppf([RARE, 1 - RARE], result.redundancy)
    assert low < result.sigma0**2 * result.redundancy < high
    np.testing.assert_array_equal(result.tools_mm["far"], OFFSETS_MM["far"])
    assert not any(
        parameter.name.startswith("tool.") for parameter in result.parameters
    )


def test_a_prediction_takes_the_tools_that_others_gave():
    exact = measured(["", "low", "far"], 12, Noise(0.0, 0.0))
    first = np.arange(len(exact.poses)) % 12 < 8
    campaign = placed(exact.part(first), arm_value(TRUE))
    for places, tools in ((places_of(campaign), campaign.tools_mm), ({}, None)):
        prediction = predict(exact.part(~first), arm_value(TRUE), places, tools)
        assert prediction.distances_mm.max() < 1e-5


def written_arm(folder):
    path = folder / "design.toml"
    text = rewritten_text(arm_value(TRUE).model_dump(by_alias=True, exclude_unset=True))
    path.write_text(text)
    return path


@pytest.mark.slow
def test_the_commands_take_several_tools_and_others_refuse_them(campaign, tmp_path):
    folder = written(campaign, tmp_path)
    text = (folder / "campaign.toml").read_text()
    tools = "".join(f'[[tools]]\nname = "{name}"\n' for name in OFFSETS_MM)
    (folder / "campaign.toml").write_text(text + tools)
    names = ["", *OFFSETS_MM]
    header, *rows = (folder / "poses.csv").read_text().splitlines()
    cells = [names[tool] for tool in campaign.poses.tools]
    lines = [f"{header},tool", *map(",".join, zip(rows, cells, strict=True))]
    (folder / "poses.csv").write_text("\n".join(lines) + "\n")
    arm = written_arm(tmp_path)
    words = [str(folder), "--arm", str(arm)]
    ended = invoke("identify", *words, "-o", tmp_path / "out")
    values = json.loads((tmp_path / "out" / "identification.json").read_text())
    vector_mm = values["tools"]["far"]["vector_mm"]
    assert f"Tool far: vector_mm = [{vector_mm[0]:.4f}, " in ended.output
    ended = invoke("predict", *words, "--fit-on", folder)
    ended = invoke("probe", "pivot", folder, "--arm", arm, status=2)
    assert (
        "only `traverse identify`, `diagnose`, `predict` and `verify`" in ended.output
    )


def eccentric(campaign, joint, size_rad):
    readings_rad = campaign.poses.angles_rad.copy()
    readings_rad[:, joint] += size_rad * np.sin(readings_rad[:, joint] + 0.7)
    return campaign.with_poses(angles_rad=readings_rad)


@pytest.mark.slow
def test_an_effect_is_named_from_poses_with_several_tools(tmp_path):
    campaign = eccentric(measured(["", "low", "far"], 60), 1, 1e-4)
    diagnosis = diagnose(campaign, arm_value(TRUE), DiagnosisOptions(n_draws=200))
    (term,) = diagnosis.terms
    assert term.status == "named"
    assert (term.candidate.kind, term.candidate.joint) == ("encoder_eccentricity", "J2")
    cosine, sine = term.parameters.values()
    size_rad = np.hypot(cosine.value, sine.value)
    assert abs(size_rad - 1e-4) < 4 * max(cosine.std, sine.std)
    assert diagnosis.gap.closed > 0.9
    write_diagnosis(tmp_path, diagnosis, written_arm(tmp_path))
    values = json.loads((tmp_path / "diagnosis.json").read_text())
    vector_mm = values["tools"]["far"]["vector_mm"]
    assert np.linalg.norm(vector_mm) == pytest.approx(
        np.linalg.norm(OFFSETS_MM["far"]), abs=0.05
    )
    assert list(tmp_path.glob("term-*.png"))
