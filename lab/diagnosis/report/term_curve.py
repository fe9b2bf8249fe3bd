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
from traverse.lab.adjustment import ArmValues
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.diagnosis.model.result import Diagnosis
from traverse.lab.diagnosis.report.discrepancies import Discrepancies
from traverse.lab.first_moments import first_moments, states_no_mass
from traverse.lab.outcomes.diagnosis import Term
from traverse.plurals import counted

# Waves that repeat more often are drawn one upon the other.
_MOST_PERIODS = 6


@dataclass(frozen=True, slots=True, eq=False)
class DrawnCovariate:
    """A quantity that poses are drawn over.

    Attributes:
        label: With its unit.
        values: (n_poses,); NaN where unknown.
        is_function: Whether the term is a function of it alone, so that a line can
            be drawn.
        signs: Of the covariate where shifts have none of their own, (n_poses,).
        one_direction: Whether shifts point the same way in all poses.
    """

    label: str
    values: Floats
    is_function: bool
    signs: Floats
    one_direction: bool = False


def covariate_of(
    term: Term, campaign: Campaign, amounts: Floats, reference_c: float
) -> DrawnCovariate:
    """Choose what a term is drawn over; the last resort is what it does to each pose.

    Thermal effects are zero at the reference temperature.
    """
    kind, joint = term.candidate.kind, term.candidate.joint
    poses = campaign.poses
    plain = np.ones(len(poses))
    row = EFFECT_KINDS[kind]
    name = next(iter(row.columns(joint)), None)
    if term.candidate.is_curve:
        name = term.candidate.covariate
    compliance = getattr(term.effect, "compliance_rad_nm", 0.0)
    if row.acts_on == "angle" and compliance != 0.0:
        # The joint turns further: as if it had read too little.
        label = f"gravity torque about {joint} [N m]"
        return DrawnCovariate(label, -amounts / compliance, True, plain)
    if name is None:
        size = float(np.nanmax(np.abs(amounts), initial=0.0))
        label = "what the effect does to the pose, of the largest"
        return DrawnCovariate(label, amounts / (size or 1.0), True, plain)
    label, values = column(campaign, name)
    if row.family is Family.WARM:
        away = np.nan_to_num(values - reference_c)
        return DrawnCovariate(label, values, joint is not None, away)
    periods = _periods(term)
    if periods > _MOST_PERIODS and name == f"{joint}_rad":
        label = (
            f"reading of {joint} within one of {counted(periods, 'period')} [degrees]"
        )
        values = np.mod(values, 360.0 / periods)
    one_direction = row.family is Family.SLOW and joint is None
    return DrawnCovariate(label, values, row.is_function, plain, one_direction)


def _periods(term: Term) -> float:
    """Count the periods of a term in a turn of its joint; 0: it has none."""
    if term.harmonic is not None:
        return term.harmonic
    is_wave = EFFECT_KINDS[term.candidate.kind].is_wave
    return (term.candidate.periods or 0) if is_wave else 0


def column(campaign: Campaign, name: str) -> tuple[str, Floats]:
    """Find a column of the table of poses, angles in degrees: its label and values."""
    poses = campaign.poses
    unknown = np.full(len(poses), np.nan)
    columns = {
        "time_s": (time_label(campaign), poses.time_s),
        "temperature_c": ("temperature [°C]", poses.temperature_c),
        "force_n": ("contact force [N]", poses.force_n),
    }
    if name in columns:
        label, values = columns[name]
        return label, unknown if values is None else values
    is_warm_known = poses.temperature_c is not None or (
        poses.joint_temperatures_c is not None
    )
    warm_c = campaign.block().temperatures_c(slice(None)).T if is_warm_known else None
    for end, label, table in (
        ("_temperature_c", "temperature of {} [°C]", warm_c),
        ("_speed_rad_s", "speed of {} [rad/s]", poses.speeds_rad_s),
        ("_approach", "sense of the last motion of {}", poses.approaches),
        ("_rad", "reading of {} [degrees]", np.degrees(poses.angles_rad)),
    ):
        joint = name.removesuffix(end)
        if name != joint and joint in campaign.joint_names:
            column = campaign.joint_names.index(joint)
            return label.format(joint), unknown if table is None else table[:, column]
    return name, unknown


def time_label(campaign: Campaign) -> str:
    return "number of the pose" if campaign.time_is_order else "time [s]"


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
        return self.arm.each_tool(
            self.campaign.poses,
            lambda geometry, chosen: compute(geometry, block.part(chosen)),
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
    needed = first_moments(arm) if states_no_mass(arm) else ()
    effects = effects_of(arm, (term.effect, *needed), campaign.span)
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
        (amounts(_changed(effects, row, step)) - fitted) / step
        if step > 0.0
        else np.zeros_like(fitted)
        for row, step in enumerate(steps)
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
    return np.where(seen[:, np.newaxis], signs[:, np.newaxis] * units, 0.0)


def value_covariance(diagnosis: Diagnosis, term: Term, effects: ArmEffects) -> Floats:
    """Find the covariance of the values of a term.

    From the final fit, scaled to the standard deviations reported for the term; of a
    term that is not in it, those alone. In the order of its values, (n_values,
    n_values).
    """
    fitted = _fitted_covariance(diagnosis, effects)
    if term.candidate.is_curve and fitted is not None:
        # Its mean is the joint's zero: the fit holds it, single values do not know.
        return fitted
    known = {key: estimate.std for key, estimate in term.parameters.items()}
    parts = [
        np.ravel(known.get(key, np.zeros_like(value)))
        for key, value in effects.corrections[0].keys.items()
    ]
    stds = np.concatenate(parts).astype(np.float64)
    correlation = np.eye(len(stds))
    if fitted is not None:
        sizes = np.sqrt(np.maximum(np.diag(fitted), 0.0))
        safe = np.where(sizes > 0.0, sizes, 1.0)
        correlation = fitted / np.outer(safe, safe)
    return stds[:, np.newaxis] * correlation * stds


def _fitted_covariance(diagnosis: Diagnosis, effects: ArmEffects) -> Floats | None:
    """Find the covariance of the values in the final fit; None: not all are in it."""
    adjustment = diagnosis.all_terms
    parameters = adjustment.network.parameters
    model = parameters.effects
    if model is None:
        return None
    prefix = effects.name(effects.corrections[0])
    corrections = model.effects.corrections
    names = [model.effects.name(correction) for correction in corrections]
    if prefix not in names:
        return None
    index = names.index(prefix)
    geometry = adjustment.state.arm.geometry
    coordinates = model.coordinates(geometry, index)
    of_effect = parameters.n_geometric + np.arange(coordinates.start, coordinates.stop)
    places = np.flatnonzero(parameters.free)
    if not np.all(np.isin(of_effect, places)):
        return None
    inverse = adjustment.split.inverse[np.searchsorted(places, of_effect)]
    directions = corrections[index].free_directions(geometry)
    covariance: Floats = directions @ (inverse @ inverse.T) @ directions.T
    return adjustment.sigma0**2 * covariance
