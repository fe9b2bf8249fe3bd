"""Curves without a name: every joint moved as a smooth function of every covariate.

The curves are those of the arm file's kind `empirical`: natural cubic splines through
values at knots, so that what is found here can be applied as it is, and leaves
nothing of itself behind. Knots are at quantiles of the covariate: each has its poses.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects.readings.empirical import Empirical
from traverse.kinematics.effects.readings.spline import spline_amounts
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.kinematics.model.geometry import Geometry, across
from traverse.lab.diagnosis.model.candidate import Bank
from traverse.lab.diagnosis.model.covariates import (
    CovariateColumn,
    approach_columns,
    covariate_columns,
)
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations
from traverse.lab.outcomes.candidate import BankName, Candidate

Knots = tuple[float, ...]

_CURVE_RAD = EFFECT_KINDS[Empirical.kind].size
_CURVE_MM = 0.01
N_KNOTS = 10
# Of a joint's angle over its own reading also so many: a fault of the encoder may be
# narrower than the knots lie apart. Each has its poses, or it would follow blunders.
N_FINE_KNOTS = 20
_POSES_A_KNOT = 8
# Of the covariate's range: knots closer than that are one.
_LEAST_STEP = 1e-3
_OF_ALL = ("time_s", "temperature_c")
# What may move a base that is not held well; with the senses of approach.
_OF_BASE = (*_OF_ALL, "force_n")
# An artefact that creeps does so steadily.
N_ARTEFACT_KNOTS = 3


def generic_bank(rows: ObservationEquations) -> Bank:
    """Compute curves of every joint over every covariate that varies.

    A joint's angle is curved over all readings, time, temperature and force, and over
    the joint's own temperature and speed; over its own reading once more with finer
    knots. Two tilts of its axis and three shifts of its origin are curved over its own
    reading, time and temperature. The base shifts and tilts (as the first axis does)
    over time, temperature, force and the sense of approach of every joint: what is not
    held well rocks. Every artefact creeps with time. Columns are in units of 1e-5 rad
    or 0.01 mm at a knot, less their mean over the poses that take part, whitened,
    (n_rows, n_columns).
    """
    joints = rows.adjustment.network.campaign.joint_names
    by_tilts, by_shifts = _by_carriers(rows)
    candidates: list[Candidate] = []
    parts: list[Floats] = []
    used = rows.used_poses
    n_fine = min(N_FINE_KNOTS, len(used) // _POSES_A_KNOT)

    def base_moves(covariate: CovariateColumn, knots: Knots, curves: Floats) -> None:
        candidates.append(_candidate(covariate, knots, None, "shift", ("x", "y", "z")))
        parts.append(_products(rows.by_centre * _CURVE_MM, curves))
        if covariate.name not in _OF_ALL:  # else the first axis tilts below
            candidates.append(
                _candidate(covariate, knots, joints[0], "tilt", ("v", "w"))
            )
            parts.append(_products(by_tilts[:, 0] * _CURVE_RAD, curves))

    for column in approach_columns(rows):
        knots = spline_knots(column.values[used])
        base_moves(column, knots, _curves(rows, column, knots))
    for column in covariate_columns(rows):
        knots = spline_knots(column.values[used])
        curves = _curves(rows, column, knots)
        if column.name in _OF_BASE:
            base_moves(column, knots, curves)
        if column.name == "time_s":
            for candidate, part in _artefact_curves(rows, column):
                candidates.append(candidate)
                parts.append(part)
        for joint, name in enumerate(joints):
            if column.joint not in (None, joint) and not column.is_reading:
                continue
            candidates.append(_candidate(column, knots, name, "angle", ()))
            by_reading = rows.by_readings[:, joint : joint + 1]
            parts.append(_products(by_reading * _CURVE_RAD, curves))
            is_own = column.is_reading and column.joint == joint
            if is_own and n_fine > N_KNOTS:
                fine = spline_knots(column.values[used], n_fine)
                candidates.append(_candidate(column, fine, name, "angle", ()))
                parts.append(
                    _products(by_reading * _CURVE_RAD, _curves(rows, column, fine))
                )
            if column.name in _OF_ALL or is_own:
                candidates.append(_candidate(column, knots, name, "tilt", ("v", "w")))
                parts.append(_products(by_tilts[:, joint] * _CURVE_RAD, curves))
                directions = "v", "w", "u"
                candidates.append(_candidate(column, knots, name, "shift", directions))
                parts.append(_products(by_shifts[:, joint] * _CURVE_MM, curves))
    stacked = np.concatenate(parts, axis=1) if parts else np.empty((len(rows.poses), 0))
    return Bank(tuple(candidates), rows.decorrelated(stacked))


def _artefact_curves(
    rows: ObservationEquations, covariate: CovariateColumn
) -> Iterator[tuple[Candidate, Floats]]:
    """Let each artefact of several shift steadily, (n_rows, 3 * n_knots) each."""
    artefacts = rows.adjustment.network.campaign.poses.artefacts
    touched = np.unique(artefacts[rows.used_poses])
    if len(touched) < 2:
        return  # the base as well
    for index in touched.tolist():
        mine = rows.used_poses[artefacts[rows.used_poses] == index]
        knots = spline_knots(covariate.values[mine], N_ARTEFACT_KNOTS)
        if len(mine) < _POSES_A_KNOT * len(knots) or len(knots) < 2:
            continue
        curves = _curves(rows, covariate, knots)
        is_there = (rows.poses >= 0) & (artefacts[rows.poses] == index)
        moved = -rows.by_centre * _CURVE_MM * is_there[:, np.newaxis]
        plain = _candidate(covariate, knots, None, "shift", ("x", "y", "z"))
        of = rows.adjustment.network.campaign.artefacts[index].id
        yield replace(plain, artefact=of), _products(moved, curves)


def spline_knots(values: Floats, most: int = N_KNOTS) -> Knots:
    """Place knots, rising, where the values are: as many between any two of them.

    Fewer where there are fewer different values.
    """
    quantiles = np.quantile(values, np.linspace(0.0, 1.0, most))
    distinct = np.unique(values)
    if len(distinct) < most:
        quantiles = distinct
    step = _LEAST_STEP * (quantiles[-1] - quantiles[0])
    knots = [float(quantiles[0])]
    for quantile in quantiles[1:].tolist():
        if quantile - knots[-1] > step:
            knots.append(quantile)
    # The last knot is the largest value, or values beyond it could not be separated.
    knots[-1] = float(quantiles[-1])
    return tuple(knots)


def _curves(
    rows: ObservationEquations, covariate: CovariateColumn, knots: Knots
) -> Floats:
    """Unit curves at every row, their mean taken out, (n_rows, n_knots)."""
    curves = spline_amounts(knots, covariate.values).T
    curves = curves - curves[rows.used_poses].mean(axis=0)
    at_rows: Floats = curves[rows.poses]
    return at_rows


def _products(directions: Floats, curves: Floats) -> Floats:
    """Multiply each direction by each curve, (n_rows, n_directions * n_knots)."""
    products: Floats = directions[:, :, np.newaxis] * curves[:, np.newaxis]
    return products.reshape(len(products), -1)


def _by_carriers(rows: ObservationEquations) -> tuple[Floats, Floats]:
    """How rows change where a joint's carrier tilts by 1 rad or shifts by 1 mm.

    It tilts about v and w across the axis, (n_rows, n_joints, 2), and shifts with the
    joint's origin along v, w and u, (n_rows, n_joints, 3).
    """
    both = rows.each_tool(
        lambda geometry, chosen: _carried(geometry, rows.angles_rad(geometry, chosen))
    )[rows.poses]
    by_both = np.einsum("ri,rkdi->rkd", rows.by_centre, both[:, :, :5])
    by_both[:, :, :2] += np.einsum("ri,rkdi->rkd", rows.by_turn, both[:, :, 5:])
    return by_both[:, :, :2], by_both[:, :, 2:]


def _carried(geometry: Geometry, angles_rad: Floats) -> Floats:
    """How far such tilts and shifts move the ball [mm], and turn the last body [rad].

    (n_poses, n_joints, 5 + 2, 3)
    """
    rotations = probe_derivatives(geometry, angles_rad).by_links
    links_mm = geometry.links_mm.copy()
    links_mm[-1] += geometry.probe_vector_mm
    steps_mm = np.einsum("nikj,kj->nki", rotations, links_mm)
    reaches_mm = np.cumsum(steps_mm[:, ::-1], axis=1)[:, ::-1]
    frames = np.stack([[*across(axis), axis] for axis in geometry.axes])
    # Directions in the posture, (n_poses, n_joints, which, 3): P_(k-1) times each.
    carried = np.empty((len(angles_rad), *frames.shape))
    carried[:, 0] = frames[0]
    carried[:, 1:] = np.einsum("nikj,kdj->nkdi", rotations[:, :, :-1], frames[1:])
    tilts_mm = np.cross(carried[:, :, :2], reaches_mm[:, :, np.newaxis])
    return np.concatenate([tilts_mm, carried, carried[:, :, :2]], axis=2)


def _candidate(
    covariate: CovariateColumn,
    knots: Knots,
    joint: str | None,
    component: str,
    directions: tuple[str, ...],
) -> Candidate:
    key, scale = ("shift_mm", _CURVE_MM) if component == "shift" else ("", _CURVE_RAD)
    numbers = range(1, len(knots) + 1)
    if component == "angle":
        parameters = tuple(f"values_rad.{number}" for number in numbers)
    else:
        key = key or "tilt_rad"
        parameters = tuple(f"{key}.{of}.{n}" for of in directions for n in numbers)
    return Candidate(
        bank=BankName.GENERIC,
        kind=Empirical.kind,
        joint=joint,
        component=component,
        covariate=covariate.name,
        parameters=parameters,
        scales=(scale,) * len(parameters),
        keys=(("covariate", covariate.name), ("knots", knots)),
    )
