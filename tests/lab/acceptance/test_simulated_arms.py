"""Simulated arms with known errors: results of their acceptance."""

import re
from pathlib import Path

import numpy as np
import pytest

from tests.docs.pages import CHECKOUT
from tests.shared import shared
from traverse.kinematics.arm_file.arm import read_arm
from traverse.lab.acceptance.limits import NO_LIMITS
from traverse.lab.acceptance.plan import plan_of
from traverse.lab.acceptance.standards import STANDARDS, verified
from traverse.lab.measured_points.reading import read_measured
from traverse.lab.outcomes.acceptance import (
    AcceptanceEvidence,
    DecidedFigure,
    acceptance_outcome,
)
from traverse.lab.outcomes.base import State
from traverse.simulator.arm.truth import Deviations, true_arm
from traverse.simulator.campaigns import NoiseTable, write_campaign
from traverse.simulator.campaigns.acceptance.poses import (
    acceptance_poses,
    drawn_acceptance,
    touched_by,
)

ARM = read_arm(CHECKOUT / "cli" / "demo_data" / "arm.toml")
QUIET = NoiseTable(encoder_rad=0.0, contact_mm=0.0, stated=False)


@shared
def poses_of(standard):
    return acceptance_poses(ARM, standard, 5, noise=QUIET, std_mm=0.0)


def figures(poses, standard, folder, seed=1):
    write_campaign(folder, drawn_acceptance(poses, seed), ARM)
    verification = verified([read_measured(folder, ARM)], standard, NO_LIMITS)
    assert verification.missing == ()
    return {figure.key: figure for figure in verification.figures}


@pytest.mark.parametrize("standard", STANDARDS)
def test_a_perfect_arm_has_no_errors(standard, tmp_path):
    for figure in figures(poses_of(standard), standard, tmp_path).values():
        assert figure.value_mm == pytest.approx(0.0, abs=1e-6), figure.name
        assert figure.remarks == ()


def test_errors_of_length_are_those_of_the_places(tmp_path):
    # Another true arm: what the arm file makes of its readings, straight from them.
    truth = true_arm(ARM, Deviations(links_mm=0.02, axes_rad=1e-5, zeros_rad=0.0), 7)
    poses = touched_by(poses_of("iso10360-12"), truth)
    error = figures(poses, "iso10360-12", tmp_path)["e_uni"]
    data = read_measured(Path(tmp_path), ARM)
    errors = []
    for name, touched in data.touched.items():
        if name.startswith("uni-"):
            first, second = touched.places_mm[::2], touched.places_mm[1::2]
            ends = np.array(list(data.artefacts[name].points_mm.values()))
            length = np.linalg.norm(ends[1] - ends[0])
            errors += (np.linalg.norm(second - first, axis=1) - length).tolist()
    assert len(errors) == 105
    assert error.value_mm == pytest.approx(max(errors, key=abs), abs=1e-9)
    assert abs(error.value_mm) > 0.005


@pytest.mark.parametrize("standard", STANDARDS)
def test_plan_and_simulation_agree_on_what_is_touched(standard):
    plan = plan_of(standard, ARM)
    planned = {}
    for step in plan.steps:
        planned.setdefault(step.artefact, []).extend([step.feature] * step.touches)
    poses = poses_of(standard)
    touched = {}
    for index, feature in zip(poses.artefact_index, poses.feature_index, strict=True):
        artefact = poses.artefacts[index].artefact
        touched.setdefault(artefact.id, []).append(artefact.features[feature])
    assert {k: sorted(v) for k, v in planned.items()} == {
        k: sorted(v) for k, v in touched.items()
    }
    assert all(k in plan.artefacts for k in planned)
    kinds = {p.artefact.id: p.artefact.kind for p in poses.artefacts}
    assert {name: table["kind"] for name, table in plan.artefacts.items()} == kinds


def degrees_for_radians(folder: Path) -> None:
    head, *rows = (folder / "poses.csv").read_text("utf-8").splitlines()
    is_angle = [
        name.startswith("J") and name.endswith("_rad") for name in head.split(",")
    ]
    degrees = [
        ",".join(
            repr(float(np.degrees(float(value)))) if turned else value
            for value, turned in zip(row.split(","), is_angle, strict=True)
        )
        for row in rows
    ]
    (folder / "poses.csv").write_text("\n".join([head, *degrees]) + "\n", "utf-8")


def metres_for_millimetres(folder: Path) -> None:
    text = (folder / "campaign.toml").read_text("utf-8")
    lengths = re.compile(r"((?:radius|distance)_mm = )(\S+)")
    text = lengths.sub(lambda match: f"{match[1]}{float(match[2]) / 1e3}", text)
    (folder / "campaign.toml").write_text(text, "utf-8")


@pytest.mark.parametrize("standard", STANDARDS)
@pytest.mark.parametrize("mix", [degrees_for_radians, metres_for_millimetres, None])
def test_what_does_not_belong_together_is_bad(standard, mix, tmp_path):
    """Other units, or without a mix the poses of another arm."""
    poses = poses_of(standard)
    if mix is None:
        another = Deviations(links_mm=2.0, axes_rad=0.01, zeros_rad=0.3)
        poses = touched_by(poses, true_arm(ARM, another, 7))
    write_campaign(tmp_path, drawn_acceptance(poses, 1), ARM)
    if mix is not None:
        mix(tmp_path)
    verification = verified([read_measured(tmp_path, ARM)], standard, NO_LIMITS)
    figures = [
        DecidedFigure(figure.name, figure.value_mm, 1.0, "accept", ())
        for figure in verification.figures
    ]
    evidence = AcceptanceEvidence(
        figures,
        [lacking.name for lacking in verification.missing],
        contradictions=verification.contradictions,
    )
    judged = acceptance_outcome(evidence)
    assert judged.outcome.state is State.BAD
    assert judged.outcome.codes[0] == "belongs"
    assert judged.title == "Arm file, poses and artefacts do not belong together"
    assert "radians" in judged.sentences[0]
    assert judged.verdict == "withheld"
    assert "ccepted" not in " ".join(judged.sentences)


@pytest.mark.parametrize("standard", STANDARDS)
def test_an_arm_that_is_badly_off_belongs_to_its_file_all_the_same(standard, tmp_path):
    truth = true_arm(ARM, Deviations(links_mm=0.5, axes_rad=1e-3, zeros_rad=0.0), 7)
    poses = touched_by(poses_of(standard), truth)
    write_campaign(tmp_path, drawn_acceptance(poses, 1), ARM)
    verification = verified([read_measured(tmp_path, ARM)], standard, NO_LIMITS)
    assert verification.contradictions == ()
