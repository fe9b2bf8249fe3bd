"""Fits of the arm with terms: all estimated together, and what each term explains."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.arm_file.arm import Arm, Effect
from traverse.kinematics.effect_table import EFFECT_KINDS, key_unit
from traverse.kinematics.effects.arm_effects import ArmEffects
from traverse.kinematics.effects.base.correction import Correction
from traverse.kinematics.effects.columns import columns
from traverse.kinematics.effects.mechanics.deformations import Compliance
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.adjustment import (
    IteratedAdjustment,
    Network,
    Options,
    Problem,
    adjust_iteratively,
    find_starting_values,
)
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.diagnosis.model.observation_equations import (
    LEAST_EFFECT,
    ObservationEquations,
    coarseness,
    orthonormal_basis,
)
from traverse.lab.first_moments import with_first_moments
from traverse.lab.outcomes.candidate import Candidate
from traverse.lab.outcomes.diagnosis import Estimate

# Moments of weight that the poses do not bear out wander; what is sound takes up to 51.
_MOST_ITERATIONS = 60
# Of the design: no arm is built smaller, and none as much larger.
_LEAST_SIZE = 0.8


@dataclass(frozen=True, slots=True, eq=False)
class Fit(IteratedAdjustment):
    """An arm with terms, fitted to some poses of a campaign.

    Attributes:
        arm: As estimated, effects included.
    """

    arm: Arm


def fitted(
    campaign: Campaign,
    arm: Arm,
    eligible: Booleans,
    before: Fit | None = None,
    *,
    snooping: bool = True,
    never_excluded: Booleans | None = None,
) -> Fit:
    """Fit an arm and all its effects to eligible poses, (n_poses,).

    Contradicting poses are left out when snooping; poses left out of an earlier fit,
    whose noise and poses are begun with, are tried again. The noise that the campaign
    does not state is estimated.

    Raises:
        IdentificationError: The campaign lacks data that effects need.
    """
    arm = with_first_moments(arm)
    options = Options(n_suggestions=0, free_effects=True, snooping=snooping)
    problem = Problem.of(campaign, arm, options)
    noise = None if before is None else before.adjustment.network.noise
    network = problem.network(eligible, noise)
    coarse = network.parameters.with_effects_larger(coarseness(network.noise))

    def adjusted(network: Network) -> IteratedAdjustment:
        return adjust_iteratively(
            network,
            problem.design,
            options,
            first=None if before is None else before.included,
            never_excluded=never_excluded,
            most_iterations=_MOST_ITERATIONS,
        )

    # Strategy: an arm that shrinks to a point touches cones and spheres of any radius
    # without an error. Where a missing effect is gross the fit ends there, and nothing
    # is left that could tell of the effect. With the design's scale it is seen, and
    # with it in the model the scale is estimated again.
    run = adjusted(replace(network, parameters=coarse))
    if not _LEAST_SIZE < run.size < 1.0 / _LEAST_SIZE:
        run = adjusted(replace(network, parameters=coarse, holds_scale=True))
    of_run = {field.name: getattr(run, field.name) for field in fields(run)}
    return Fit(**of_run, arm=run.adjustment.arm_as_estimated(arm))


@dataclass(frozen=True, slots=True, eq=False)
class Beginning:
    """What a diagnosis begins with: as an identification, fitted tools, signs, zeros.

    Attributes:
        campaign: With tools that fit to the arm as given.
        arm: With the signs and zeros that fit.
        design: The geometry as given, with the signs that fit.
        wrong_signs: Joints that turn the other way than the arm file says.
        zero_offsets_rad: Of zeros that fit much better than the file's, by joint.
    """

    campaign: Campaign
    arm: Arm
    design: Geometry
    wrong_signs: tuple[str, ...]
    zero_offsets_rad: dict[str, float]


def begin(campaign: Campaign, arm: Arm) -> Beginning:
    """Find what fits at all, before any effect is looked for.

    Raises:
        IdentificationError: Arm and campaign do not fit together.
    """
    options = Options()
    start = find_starting_values(Problem.of(campaign, arm, options), options)
    if campaign.tools:
        names = [tool.name for tool in campaign.tools]
        vectors_mm = dict(zip(names, start.arm.tools_mm, strict=True))
        campaign = campaign.with_tools(vectors_mm, held=False)
    geometry = start.arm.geometry
    offsets_rad = geometry.zeros_rad - start.design.geometry.zeros_rad
    moved = np.flatnonzero(offsets_rad).tolist()
    joints = list(arm.joints)
    for k in {*moved, *start.reversed_joints}:
        turned = {
            "axis": tuple(geometry.axes[k].tolist()),
            "zero_rad": float(geometry.zeros_rad[k]),
        }
        joints[k] = joints[k].model_copy(update=turned)
    return Beginning(
        campaign,
        arm.model_copy(update={"joints": tuple(joints)}),
        start.design.geometry,
        tuple(arm.joints[k].name for k in start.reversed_joints),
        {arm.joints[k].name: float(offsets_rad[k]) for k in moved},
    )


def with_effects(arm: Arm, effects: tuple[Effect, ...]) -> Arm:
    """Give an arm other effects, and the first moments that these need behind them."""
    return with_first_moments(arm.model_copy(update={"effects": effects}))


@dataclass(frozen=True, slots=True)
class AddedTerm:
    """A term in the model: as chosen, and its index among the effects."""

    candidate: Candidate
    index: int


def rows_without(rows: ObservationEquations, index: int) -> ObservationEquations:
    """Take an effect out of a fit, everything else linearised."""
    model = rows.adjustment.network.parameters.required_effects
    coordinates = model.coordinates(rows.adjustment.state.arm.geometry, index)
    amplitudes = rows.adjustment.state.arm.amplitudes
    directions = model.directions(rows.adjustment.state.arm.geometry)
    sizes = directions.T @ amplitudes
    correction = model.effects.corrections[index]
    moved = sizes[coordinates] / model.tolerances[coordinates]
    phase = EFFECT_KINDS[correction.kind].phase
    if phase is not None:  # its column is no size
        moved[correction.parameters.index(phase)] = 0.0
    of_effect = _columns(rows, coordinates)
    values = rows.values + rows.columns[:, of_effect] @ moved
    left = rows.columns
    if correction.uses_gravity and model.effects.first_moments:
        left = _with_others_yielding(rows, index)
    left = np.delete(left, np.arange(of_effect.start, of_effect.stop), axis=1)
    return replace(rows, values=values, columns=left, basis=orthonormal_basis(left))


def _with_others_yielding(rows: ObservationEquations, index: int) -> Floats:
    """Compute A with first moments as if one effect did not yield to them."""
    model = rows.adjustment.network.parameters.required_effects
    effects = model.at(rows.adjustment.state.arm.amplitudes)
    yielding = [
        correction
        for at, correction in enumerate(effects.corrections)
        if isinstance(correction, Compliance) and at != index
    ]
    changed = rows.columns.copy()
    moved = effect_columns(rows, effects, effects.first_moments, yielding)
    first = _columns(rows, slice(0, 0)).start
    changed[:, first:][:, model.moments] = moved * model.tolerances[model.moments]
    return changed


def effect_columns(
    rows: ObservationEquations,
    effects: ArmEffects,
    corrections: Sequence[Correction],
    yielding: Sequence[Compliance] | None = None,
) -> Floats:
    """Compute how rows change with each value of some effects, (n_rows, n_values).

    Args:
        rows: Of a fit.
        effects: Those that are applied.
        corrections: Whose values; they need not be applied.
        yielding: What first moments of mass move instead of those applied.
    """

    def moved(*, turns: bool) -> Floats:
        return rows.each_tool(
            lambda geometry, chosen: columns(
                geometry,
                effects,
                rows.block.part(chosen),
                corrections,
                yielding,
                turns=turns,
            )
        )

    turned = moved(turns=True) if rows.has_turns else None
    return rows.moved(moved(turns=False), turned)


def estimates_of(rows: ObservationEquations, index: int) -> dict[str, Estimate]:
    """Return the values of an effect with their standard deviations.

    From the rows, so that serially correlated noise is accounted for; the noise level
    is that of the residuals.
    """
    amplitudes = rows.adjustment.state.arm.amplitudes
    correction = rows.adjustment.network.parameters.required_effects.at(
        amplitudes
    ).corrections[index]
    covariance = _value_covariance(rows, index)
    stds = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    as_stds = correction.with_values(stds).keys
    return {
        key: Estimate(value, as_stds[key], key_unit(key))
        for key, value in correction.keys.items()
    }


def _value_covariance(rows: ObservationEquations, index: int) -> Floats:
    """Find the covariance of an effect's values; of a compliance by moments as found.

    How heavy the arm is would else be most of it where no mass is known.
    """
    model = rows.adjustment.network.parameters.required_effects
    coordinates = model.coordinates(rows.adjustment.state.arm.geometry, index)
    of_effect = _columns(rows, coordinates)
    positions = [*range(of_effect.start, of_effect.stop)]
    if model.effects.corrections[index].uses_gravity:
        positions += [
            _columns(rows, slice(0, 0)).start + moment for moment in model.moments
        ]
    without_effect = np.delete(rows.columns, positions, axis=1)
    basis = orthonormal_basis(without_effect)
    mine = rows.columns[:, of_effect]
    left = mine - basis @ (basis.T @ mine)
    variance = rows.sum_of_squares / max(rows.redundancy, 1)
    scales = model.tolerances[coordinates]
    # What the data do not see of it, such as the mean of a curve, was not estimated.
    squares, turns = np.linalg.eigh(left.T @ left)
    seen = squares > LEAST_EFFECT**2
    cofactors = (turns[:, seen] / squares[seen]) @ turns[:, seen].T
    covariance = variance * scales[:, np.newaxis] * cofactors * scales
    geometry = rows.adjustment.state.arm.geometry
    directions = model.effects.corrections[index].free_directions(geometry)
    of_values: Floats = directions @ covariance @ directions.T
    return of_values


def _columns(rows: ObservationEquations, coordinates: slice) -> slice:
    """Find the columns of coordinates: all effects are free and last."""
    first = rows.adjustment.network.parameters.n_free - len(
        rows.adjustment.network.parameters.required_effects.names
    )
    return slice(first + coordinates.start, first + coordinates.stop)


def has_epoch(effect: Effect, campaign: Campaign) -> bool:
    """Return whether an effect's epoch is known, or not needed.

    It is the campaign's start; a campaign need not say when it began.
    """
    is_bound_to_time = EFFECT_KINDS[effect.kind].effect_class == "A"
    return not is_bound_to_time or campaign.start_utc is not None
