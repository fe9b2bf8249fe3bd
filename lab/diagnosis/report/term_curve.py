"""Curve of a term over its covariate, and the data.

Both are one amount per pose: an error of the joint's reading, or a shift of the
ball along the way that the term moves it. What the data say with the term taken out
again is the discrepancy that is left plus the term's own amount.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effect_table import EFFECT_KINDS, Family
from traverse.kinematics.effects.arm_effects import ArmEffects, effects_of
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.pose import angle_corrections, corrected_pose
from traverse.kinematics.model.geometry import Geometry, geometry_from_arm
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.diagnosis.model.result import Diagnosis, Term
from traverse.lab.diagnosis.report.covariates import DrawnCovariate, covariate_of
from traverse.lab.diagnosis.report.discrepancies import Discrepancies
from traverse.lab.diagnosis.report.term_covariance import value_covariance
from traverse.lab.identification.equations.network import each_tool
from traverse.lab.identification.equations.parameters import ArmValues

# A move smaller than this part of the largest has no direction worth naming.
_LEAST_MOVE = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class TermCurve:
    """A term and the data over a covariate, an entry a pose.

    Attributes:
        unit: Of the amounts, "rad" or "mm".
        what: The amounts, in words.
        before: What the data said without any term, (n_poses,).
        after: What is left with all of them, (n_poses,).
        stds: Of both, by noise alone, (n_poses,).
        fitted: What the term says, (n_poses,).
        band: Its standard deviation, (n_poses,).
    """

    covariate: DrawnCovariate
    unit: str
    what: str
    before: Floats
    after: Floats
    stds: Floats
    fitted: Floats
    band: Floats


@dataclass(frozen=True, slots=True, eq=False)
class _Scene:
    """The arm and the poses that effects are looked at in."""

    arm: ArmValues
    campaign: Campaign

    def angles_rad(self, effects: ArmEffects) -> Floats:
        """Compute what effects do to the readings, (n_poses, n_joints)."""
        return self._each(
            lambda geometry, block: angle_corrections(geometry, effects, block)
        )

    def moves_mm(self, effects: ArmEffects) -> Floats:
        """Compute what effects do to the model's ball, (n_poses, 3)."""
        nothing = effects.with_values(np.zeros_like(effects.values))

        def moved_mm(geometry: Geometry, block: Block) -> Floats:
            with_them, without = (
                corrected_pose(geometry, of, block)[0] for of in (effects, nothing)
            )
            return with_them - without

        return self._each(moved_mm)

    def _each(self, compute: Callable[[Geometry, Block], Floats]) -> Floats:
        block = self.campaign.block()
        return each_tool(
            self.campaign.poses,
            self.arm,
            lambda geometry, at: compute(geometry, block.part(at)),
        )


def term_curve(
    diagnosis: Diagnosis, term: Term, before: Discrepancies, after: Discrepancies
) -> TermCurve | None:
    """Compute what a term and the data say.

    None where the term moves no pose, or the arm file has no form for it.
    """
    campaign, arm = diagnosis.campaign, diagnosis.adapted
    if term.effect is None or EFFECT_KINDS[term.candidate.kind].family is Family.LENGTH:
        return None
    effects = effects_of(arm, (term.effect,), campaign.span)
    tools_mm = diagnosis.all_terms.state.arm.tools_mm
    scene = _Scene(ArmValues(geometry_from_arm(arm), np.empty(0), tools_mm), campaign)
    covariance = value_covariance(diagnosis, term, effects)
    joint, reference_c = term.candidate.joint, arm.reference.temperature_c
    if EFFECT_KINDS[term.candidate.kind].acts_on == "angle" and joint is not None:
        index = campaign.joint_names.index(joint)

        def amounts(of: ArmEffects) -> Floats:
            if of.readings:
                return scene.angles_rad(of)[:, index]
            return after.as_reading_rad(index, scene.moves_mm(of))

        fitted = amounts(effects)
        data = [when.reading_errors_rad(index) for when in (before, after)]
        unit, what = "rad", f"{joint}: measured - simulated"
        covariate = covariate_of(term, campaign, fitted, reference_c)
    else:
        moves_mm = scene.moves_mm(effects)
        size_mm = np.linalg.norm(moves_mm, axis=1)
        covariate = covariate_of(term, campaign, size_mm, reference_c)
        directions = _directions(moves_mm, covariate)

        def amounts(of: ArmEffects) -> Floats:
            along: Floats = np.einsum("ni,ni->n", scene.moves_mm(of), directions)
            return along

        fitted = amounts(effects)
        data = [when.along(directions) for when in (before, after)]
        unit, what = "mm", "ball, along the effect"
    steps = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    slopes = [
        (amounts(_changed(effects, at, step)) - fitted) / step
        if step > 0.0
        else np.zeros_like(fitted)
        for at, step in enumerate(steps)
    ]
    by_values = np.stack(slopes, axis=1)
    if term.candidate.is_curve:
        # A curve of readings has no height of its own: that is the joint's zero.
        by_values = by_values - by_values.mean(axis=0)
    variance = np.einsum("np,pq,nq->n", by_values, covariance, by_values)
    (at_first, _), (at_last, stds) = data
    return TermCurve(
        covariate,
        unit,
        what,
        at_first,
        at_last,
        stds,
        fitted,
        np.sqrt(np.maximum(variance, 0.0)),
    )


def _changed(effects: ArmEffects, at: int, step: float) -> ArmEffects:
    values = effects.values.copy()
    values[at] += step
    return effects.with_values(values)


def _directions(moves_mm: Floats, covariate: DrawnCovariate) -> Floats:
    """Choose the way along which to look at each pose, unit vectors or zero."""
    if covariate.one_direction:
        total = moves_mm.sum(axis=0)
        size = float(np.linalg.norm(total))
        if size == 0.0:
            return np.zeros_like(moves_mm)
        return np.broadcast_to(total / size, moves_mm.shape)
    sizes = np.linalg.norm(moves_mm, axis=1)
    seen = sizes > _LEAST_MOVE * sizes.max(initial=0.0)
    units = moves_mm / np.where(seen, sizes, 1.0)[:, np.newaxis]
    signs = np.where(covariate.signs < 0.0, -1.0, 1.0)
    found: Floats = np.where(seen[:, np.newaxis], signs[:, np.newaxis] * units, 0.0)
    return found
