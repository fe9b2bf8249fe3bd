"""The table of docs/strangers.md.

Each arm is identified with some of its poses and judged by all of the others, beside
the nominal arm with its tool fitted, and beside plain least squares by scipy. All are
judged in the same way (`plain.held_out_mm`).
"""

import tempfile
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.strangers import plain
from benchmarks.strangers.sets import Measured, make_arm
from benchmarks.trials.lines import Line
from benchmarks.trials.series import Series
from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm, read_arm
from traverse.kinematics.effects.arm_effects import effects_of
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.pose import corrected_pose
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.lab.adjustment.prepare import IdentificationError
from traverse.lab.campaign.campaign import Campaign, read_campaign
from traverse.lab.diagnosis.diagnose import diagnose
from traverse.lab.diagnosis.model.result import DiagnosisOptions
from traverse.lab.diagnosis.report.files import arm_with_provenance
from traverse.lab.identification.identify import identify

HEAD = (
    "| set | poses used | kept aside | tool alone | scipy | Traverse "
    "| diagnosed | the owners' figures |\n|---|---|---|---|---|---|---|---|"
)


def series(sets: Sequence[Measured], *, diagnose: bool) -> list[Series[Measured]]:
    options = " diagnosed" * diagnose
    run = partial(row, diagnose)
    return [
        Series(f"table{options}: {measured.name}", partial(_as_it_is, measured), run)
        for measured in sets
    ]


def _as_it_is(measured: Measured, _seed: int) -> Measured:
    return measured


def report(lines: Sequence[Line]) -> list[str]:
    title = "Distance of poses kept aside: mean, largest [mm].\n"
    return [title, HEAD, *(f"| {' | '.join(line['cells'])} |" for line in lines)]


def row(with_diagnosis: bool, measured: Measured) -> Line:
    arm, campaign = nominal_and_campaign(measured)
    tool, rival = plain_fits(arm, measured)
    return {
        "cells": [
            measured.name,
            str(len(campaign.poses)),
            f"{measured.held_by}: {np.count_nonzero(measured.is_kept)}",
            figures(tool),
            figures(rival),
            *ours(measured, campaign, arm, with_diagnosis),
            measured.owners,
        ]
    }


def plain_fits(arm: Arm, measured: Measured) -> tuple[Floats, Floats]:
    tool = plain.fitted(plain.chain_of(arm), measured, tool_only=True)
    rival = plain.fitted(tool, measured)
    tool_mm, rival_mm = (
        plain.held_out_mm(chain.places_mm(measured.angles_rad), measured)
        for chain in (tool, rival)
    )
    return tool_mm, rival_mm


def nominal_and_campaign(measured: Measured) -> tuple[Arm, Campaign]:
    with tempfile.TemporaryDirectory() as name:
        arm = read_arm(make_arm(measured, Path(name)))
        used = measured.write(Path(name) / "used", ~measured.is_kept)
        return arm, read_campaign(used, [joint.name for joint in arm.joints])


def ours(
    measured: Measured, campaign: Campaign, arm: Arm, with_diagnosis: bool
) -> tuple[str, str]:
    """Identify, and diagnose the remainder; return the predictions of each arm."""
    begun_s = time.monotonic()
    try:
        identified = identify(campaign, arm).arm
    except IdentificationError as error:
        return str(error), "-"
    plainly = figures(distances_mm(measured, identified))
    plainly += f" ({time.monotonic() - begun_s:.0f} s)"
    if not with_diagnosis:
        return plainly, "-"
    begun_s = time.monotonic()
    diagnosis = diagnose(campaign, identified, DiagnosisOptions())
    diagnosed = figures(distances_mm(measured, arm_with_provenance(diagnosis)))
    n = sum(term.accepted for term in diagnosis.terms)
    taken_s = time.monotonic() - begun_s
    return plainly, f"{diagnosed}, {diagnosis.verdict}, {n} terms ({taken_s:.0f} s)"


def distances_mm(measured: Measured, arm: Arm) -> Floats:
    """Distances [mm] of the poses kept aside, by an arm file with its effects."""
    effects = effects_of(arm, arm.effects)
    positions_mm, _, _ = corrected_pose(
        geometry_from_arm(arm), effects, Block(measured.angles_rad)
    )
    return plain.held_out_mm(positions_mm, measured)


def figures(distances: Floats) -> str:
    return f"{np.mean(distances):.3f}, {np.max(distances):.2f}"
