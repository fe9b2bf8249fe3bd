"""Targets of a collection: a number of touches for every feature, or a plan's steps."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from traverse.arrays import Floats, Integers
from traverse.kinematics.effect_table import Vector
from traverse.lab.campaign.campaign_file import CampaignFile
from traverse.strict_toml.problems import FileError, Problem, unknown_name_message
from traverse.strict_toml.reader import StrictModel

PLAN = "plan.toml"
SHELLS = 3
_MARKS = "·▁▂▃▄▅▆▇█"


class PlanStep(StrictModel):
    """One step: so many touches of a feature, and what to do in a sentence."""

    artefact: str
    feature: str = ""
    touches: int = Field(ge=1, le=100_000)
    say: str = ""


class PlanFile(StrictModel):
    """`plan.toml` as written: steps in their order, and the working volume."""

    schema_: Literal["traverse/collection-plan/1"] = Field(alias="schema")
    centre_mm: Vector = (0.0, 0.0, 0.0)
    reach_mm: float | None = Field(default=None, gt=0.0)
    steps: tuple[PlanStep, ...] = Field(min_length=1)


def volume_picture(
    places_mm: Sequence[Sequence[float]], plan: PlanFile
) -> list[tuple[str, str]]:
    """Return where in the working volume has been touched.

    For each shell of the volume its name, and its eight octants as blocks.
    """
    if plan.reach_mm is None or not places_mm:
        return []
    counts = volume_counts(np.array(places_mm, dtype=np.float64), plan)
    largest = max(1, int(counts.max()))
    lines = []
    for shell, row in enumerate(counts.tolist()):
        low, high = shell / SHELLS, (shell + 1) / SHELLS
        marks = "".join(_MARKS[-(-count * 8 // largest)] for count in row)
        lines.append((f"{low:.0%} to {high:.0%} of the reach", marks))
    return lines


def volume_counts(places_mm: Floats, plan: PlanFile) -> Integers:
    """Count places (n, 3) in shells and octants, (3, 8)."""
    from_middle_mm = places_mm - np.array(plan.centre_mm)
    away = np.linalg.norm(from_middle_mm, axis=1) / (plan.reach_mm or 1.0)
    shells = np.clip((away * SHELLS).astype(np.int64), 0, SHELLS - 1)
    octants = (from_middle_mm > 0.0) @ np.array([1, 2, 4])
    counts = np.zeros((SHELLS, 8), dtype=np.int64)
    np.add.at(counts, (shells, octants), 1)
    return counts


@dataclass(frozen=True, slots=True)
class Target:
    """Something to be touched so many times; nothing is said where names are enough."""

    artefact: str
    feature: str
    kind: str
    wanted: int
    say: str = ""

    def __str__(self) -> str:
        return f"{self.artefact} {self.feature}".strip()


def targets_of(file: CampaignFile, wanted: int) -> tuple[Target, ...]:
    """Targets of a campaign: each feature so many times."""
    return tuple(
        Target(artefact.id, feature, artefact.kind, wanted)
        for artefact in file.artefacts
        for feature in artefact.features or ("",)
    )


def planned_targets(
    plan: PlanFile, file: CampaignFile, source: str
) -> tuple[Target, ...]:
    """Turn steps into targets, counted up: a feature may recur.

    Raises:
        FileError: Steps name what the campaign does not have.
    """
    artefacts = {artefact.id: artefact for artefact in file.artefacts}
    problems, targets = [], []
    counts: dict[tuple[str, str], int] = {}
    for index, step in enumerate(plan.steps):
        artefact = artefacts.get(step.artefact)
        if artefact is None:
            message = unknown_name_message("artefact", step.artefact, artefacts)
            problems.append(Problem(f"steps[{index}].artefact", message))
            continue
        if artefact.features and step.feature not in artefact.features:
            message = unknown_name_message("feature", step.feature, artefact.features)
            problems.append(Problem(f"steps[{index}].feature", message))
            continue
        key = (step.artefact, step.feature)
        counts[key] = counts.get(key, 0) + step.touches
        targets.append(Target(*key, artefact.kind, counts[key], step.say))
    if problems:
        raise FileError(source, problems)
    return tuple(targets)
