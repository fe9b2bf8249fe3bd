"""Walk every place that an effect's kind passes, with a new kind.

Run by `test_planted_kind` in a copy of the packages, in which the kind was planted.
"""

import json
import sys
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tests.lab.diagnosis.diagnosed import DECISION, START
from tests.lab.diagnosis.fitted_rows import measured
from tests.simulator.effects.test_played_effects import SAME_MM, rigid, worst_mm
from traverse.kinematics.arm_file.arm import effect_from_table, read_arm, write_arm
from traverse.kinematics.effects.arm_effects import effects_from_arm
from traverse.lab.diagnosis.advice.minimal_detectable import planned
from traverse.lab.diagnosis.candidates.library import library_bank
from traverse.lab.diagnosis.diagnose import diagnose
from traverse.lab.diagnosis.report.files import report_page
from traverse.lab.diagnosis.report.names import candidate_label, term_size_text
from traverse.lab.diagnosis.report.outcome import diagnosis_json
from traverse.lab.diagnosis.report.pictures import plots_of
from traverse.lab.identification.identify import Options, identify
from traverse.lab.measured_points.reading import measured_campaign
from traverse.simulator.campaigns import with_effects

KIND, LABEL = "half_wave", "wave of half a period a turn"
VALUES = {"cos_rad": 4e-5, "sin_rad": -3e-5}


@cache
def effect():
    return effect_from_table({"kind": KIND, "joint": "J3", **VALUES})


def with_kind():
    """A campaign of an arm that has it, and the arm."""
    measurement = measured().with_effect(effect())
    return replace(measurement.campaign, start_utc=START), measurement.arm


def walk_arm_file():
    arm = measured().arm.model_copy(update={"effects": (effect(),)})
    with tempfile.TemporaryDirectory() as folder:
        write_arm(Path(folder) / "arm.toml", arm)
        assert read_arm(Path(folder) / "arm.toml") == arm
    names = effects_from_arm(arm).parameter_names
    assert names == (f"J3.{KIND}.cos_rad", f"J3.{KIND}.sin_rad")


def walk_simulator():
    """What the simulator plays is undone by the correction, and by nothing else."""
    poses = with_effects(rigid(), [effect()])
    assert worst_mm(poses, poses.effects) < SAME_MM
    assert worst_mm(poses, ()) > 0.01


def walk_identification():
    campaign, arm = with_kind()
    nothing = effect().model_copy(update=dict.fromkeys(VALUES, 0.0))
    design = arm.model_copy(update={"effects": (nothing,)})
    result = identify(campaign, design, Options(free=(f"*{KIND}*",), n_suggestions=0))
    assert result.arm.effects[0].values == pytest.approx(VALUES, abs=5e-6)
    mine = {
        parameter.name: parameter.unit
        for parameter in result.parameters
        if KIND in parameter.name
    }
    assert mine == {f"J3.{KIND}.cos_rad": "rad", f"J3.{KIND}.sin_rad": "rad"}


def walk_candidates():
    bank = library_bank(measured().rows(), measured().arm)
    joints = [
        candidate.joint for candidate in bank.candidates if candidate.kind == KIND
    ]
    assert joints == [f"J{k}" for k in range(1, 8)]
    entries = planned(measured().campaign, measured().arm)
    (mine,) = (e for e in entries if e.candidate.identity[:2] == (KIND, "J3"))
    assert 0.0 < mine.minimum.value < 1e-4
    assert mine.minimum.unit == "rad"


def walk_diagnosis():
    diagnosis = diagnose(*with_kind(), DECISION)
    (term,) = diagnosis.terms
    assert (term.candidate.kind, term.candidate.joint) == (KIND, "J3")
    assert candidate_label(term.candidate) == f"{LABEL}, joint J3"
    assert "µrad" in term_size_text(term)
    assert LABEL in report_page(diagnosis, plots_of(diagnosis))
    assert diagnosis_json(diagnosis)["terms"][0]["kind"] == KIND
    assert diagnosis.adapted.effects[0].values == pytest.approx(VALUES, abs=5e-6)


def walk_acceptance():
    campaign, arm = with_kind()
    plain = measured_campaign(campaign, arm, campaign.artefacts)
    known = arm.model_copy(update={"effects": (effect(),)})
    corrected = measured_campaign(campaign, known, campaign.artefacts)
    name = campaign.artefacts[0].id
    moved_mm = corrected.of(name).places_mm - plain.of(name).places_mm
    assert np.linalg.norm(moved_mm, axis=1).max() > 1e-3


def walk_docs():
    """Pages do not know it, and the test that holds them to the table says so."""
    from tests.docs.test_reference import (  # noqa: PLC0415 - needs much else
        test_effects_are_all_there_with_class_joint_and_keys as pages_know_all,
    )

    try:
        pages_know_all()
    except AssertionError:
        return
    raise ValueError("the test of the pages takes a kind that no page has")


WALKS = {
    name: walk for name, walk in list(globals().items()) if name.startswith("walk_")
}


def result_of(walk):
    """What became of a walk."""
    try:
        walk()
    except Exception as error:  # noqa: BLE001 - every failure is reported
        return f"failed: {type(error).__name__} {error}"
    return "passed"


if __name__ == "__main__":
    wanted = sys.argv[1:] or WALKS
    json.dump({name: result_of(WALKS[name]) for name in wanted}, sys.stdout)
