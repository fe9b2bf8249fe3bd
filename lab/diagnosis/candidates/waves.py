"""Waves of a joint's reading: harmonics, and any number of cycles a turn.

Harmonics go up to an order that no library would list. Orders that the sampling or the
travelled range cannot hold apart look the same here too; their likeness shows this.
Gears and belts make waves of any number of cycles.

The cycles are not known: they are searched over the periodogram of every joint, and
their evidence is the mean over all cycles that were looked at, so that the best of many
counts for less. What repeats a whole number of times, as far as poses resolve it, and
has an order in the bank of harmonics, is left to the encoder.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects.readings.harmonics import (
    EncoderEccentricity,
    EncoderHarmonic,
    TransmissionError,
)
from traverse.lab.diagnosis.candidates.library import HIGHEST_ORDER
from traverse.lab.diagnosis.candidates.scoring import log_evidences
from traverse.lab.diagnosis.model.candidate import Bank, candidate_of_kind
from traverse.lab.diagnosis.model.observation_equations import ObservationEquations
from traverse.lab.outcomes.candidate import BankName, Candidate

MOST_CYCLES = EFFECT_KINDS[TransmissionError.kind].most["cycles"]
_SIZE_RAD = EFFECT_KINDS[TransmissionError.kind].size
# Fewer periods than that within what a joint has travelled are a curve, not a wave.
_LEAST_PERIODS = 2.0
# Cycles that are looked at, for each period more within the travel.
_STEPS_A_PERIOD = 4
# Looked at at once, and between two of them when the best is refined.
_AT_ONCE = 400
_REFINED = 33
# Of the statistic: one more freedom explains more than that in 1 % of cases.
_WHOLE = 6.6
# Of the larger square of a wave's two directions: less is rounding.
_LEAST_SQUARE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Periodogram:
    """The waves of one joint.

    Attributes:
        cycles: That were looked at, rising, (n_cycles,).
        statistics: T of each, (n_cycles,).
        evidences: Log Bayes factor of each, (n_cycles,).
        best: Cycles with the largest statistic, refined; None: left to the encoder.
    """

    joint: str
    cycles: Floats
    statistics: Floats
    evidences: Floats
    best: float | None

    @property
    def evidence(self) -> float:
        """Log Bayes factor of a wave of unknown cycles: the mean over all of them."""
        return float(np.logaddexp.reduce(self.evidences) - np.log(len(self.cycles)))


def periodograms(rows: ObservationEquations) -> tuple[Periodogram, ...]:
    """Compute the waves of every joint that has travelled far enough."""
    periodograms_of_joints = []
    used = rows.used_poses
    for joint, name in enumerate(rows.adjustment.network.campaign.joint_names):
        travel_rad = float(np.ptp(rows.block.angles_rad[used, joint]))
        if travel_rad == 0.0:
            continue
        period = 2.0 * np.pi / travel_rad
        least = max(HIGHEST_ORDER + 0.5, _LEAST_PERIODS * period)
        cycles = np.arange(least, MOST_CYCLES, period / _STEPS_A_PERIOD)
        if len(cycles):
            periodograms_of_joints.append(_periodogram(rows, joint, name, cycles))
    return tuple(periodograms_of_joints)


def transmission_bank(
    rows: ObservationEquations, searched: tuple[Periodogram, ...]
) -> Bank:
    """Take the best wave of each joint, as `wave_columns`."""
    banks = [
        wave_bank(rows, entry.joint, entry.best)
        for entry in searched
        if entry.best is not None
    ]
    parts = [np.empty((len(rows.poses), 0)), *(bank.columns for bank in banks)]
    candidates = tuple(entry for bank in banks for entry in bank.candidates)
    return Bank(candidates, np.concatenate(parts, axis=1))


def wave_bank(rows: ObservationEquations, joint: str, cycles: float) -> Bank:
    """Make the wave of a joint with known cycles; see `transmission_bank`."""
    columns = wave_columns(rows, joint, np.array([cycles]))
    kind, fixed = TransmissionError.kind, {"cycles": cycles}
    candidate = candidate_of_kind(BankName.TRANSMISSION, kind, joint, fixed, _SIZE_RAD)
    return Bank((candidate,), columns)


def log_p_of_search(searched: tuple[Periodogram, ...], level: float) -> float:
    """Return the log p below which the best of all waves is significant.

    Each of the cycles that were looked at counts as a test of its own.
    """
    return float(
        np.log(level / max(sum(len(periodogram.cycles) for periodogram in searched), 1))
    )


def wave_columns(rows: ObservationEquations, joint: str, cycles: Floats) -> Floats:
    """Compute cos and sin of cycles times a joint's reading, (n_rows, 2 * n_cycles).

    Whitened, in units of plausible amplitudes.
    """
    joint_index = rows.adjustment.network.campaign.joint_names.index(joint)
    phases_rad = rows.block.angles_rad[:, joint_index, np.newaxis] * cycles
    waves = np.stack([np.cos(phases_rad), np.sin(phases_rad)], axis=2)
    waves = waves.reshape(len(waves), -1)
    by_reading = _SIZE_RAD * rows.by_readings[:, joint_index, np.newaxis]
    return rows.decorrelated(by_reading * waves[rows.poses])


def _by_poses(
    rows: ObservationEquations, joint: int
) -> Callable[[Floats], tuple[Floats, Floats]]:
    """Prepare the normal equations of waves of a joint, added up pose by pose.

    Only where errors of poses are not correlated. Of cycles (n_cycles,) the function
    returns the squares of pairs of projected columns, (n_cycles, 2, 2), and their
    products with the residuals, (n_cycles, 2).
    """
    is_pose = rows.poses >= 0
    by_reading = np.where(is_pose, _SIZE_RAD * rows.by_readings[:, joint], 0.0)
    unknowns_and_residuals = np.column_stack([rows.basis, rows.residuals])
    readings_rad = rows.block.angles_rad[:, joint]
    of_poses = np.zeros((len(readings_rad), unknowns_and_residuals.shape[1]))
    np.add.at(
        of_poses,
        rows.poses[is_pose],
        (by_reading[:, np.newaxis] * unknowns_and_residuals)[is_pose],
    )
    weights = np.zeros(len(readings_rad))
    np.add.at(weights, rows.poses[is_pose], (by_reading**2)[is_pose])

    def normal_equations(cycles: Floats) -> tuple[Floats, Floats]:
        phases_rad = np.outer(cycles, readings_rad)
        waves = np.stack([np.cos(phases_rad), np.sin(phases_rad)], axis=1)
        products = waves @ of_poses
        absorbed, along = products[:, :, :-1], products[:, :, -1]
        squares = (waves * weights) @ waves.swapaxes(1, 2)
        return squares - absorbed @ absorbed.swapaxes(1, 2), along

    return normal_equations


def _periodogram(
    rows: ObservationEquations, joint: int, name: str, cycles: Floats
) -> Periodogram:
    by_poses = _by_poses(rows, joint) if rows.root is None else None

    def judged(some: Floats) -> tuple[Floats, Floats]:
        if by_poses is not None:
            return _statistics(rows, *by_poses(some))
        columns = rows.project(wave_columns(rows, name, some))
        pairs = columns.T.reshape(-1, 2, len(columns))
        return _statistics(rows, pairs @ pairs.swapaxes(1, 2), pairs @ rows.residuals)

    parts = [
        judged(cycles[start : start + _AT_ONCE])
        for start in range(0, len(cycles), _AT_ONCE)
    ]
    statistics, evidences = (np.concatenate(part) for part in zip(*parts, strict=True))
    start = int(np.argmax(statistics))
    step = cycles[1] - cycles[0] if len(cycles) > 1 else 0.0
    best, highest = float(cycles[start]), float(statistics[start])
    for _ in range(2):
        near = np.linspace(best - step, min(best + step, MOST_CYCLES), _REFINED)
        refined, _ = judged(near)
        best, highest = float(near[np.argmax(refined)]), float(refined.max())
        step = 2.0 * step / (_REFINED - 1)
    nearest_order = round(best)
    left: float | None = best
    if nearest_order <= HIGHEST_HARMONIC:
        variance = rows.sum_of_squares / max(rows.redundancy, 1)
        plain, _ = judged(np.array([float(nearest_order)]))
        if highest - float(plain[0]) < _WHOLE * variance:
            left = None
    return Periodogram(name, cycles, statistics, evidences, left)


def _statistics(
    rows: ObservationEquations, squares: Floats, along: Floats
) -> tuple[Floats, Floats]:
    """Compute T and the evidence of waves, each (n_cycles,).

    From squares of pairs of columns, (n_cycles, 2, 2), and their products with the
    residuals, (n_cycles, 2). A pair that is nearly one direction, or that the unknowns
    absorb, counts as nothing.
    """
    values, vectors = np.linalg.eigh(squares)
    is_seen = values > np.maximum(_LEAST_SQUARE * values[:, 1:], 1e-9)
    safe = np.where(is_seen, values, 1.0)
    turned = np.einsum("fab,fa->fb", vectors, along)
    along_squared = np.where(is_seen, turned**2 / safe, 0.0)
    evidences = log_evidences(
        along_squared,
        np.where(is_seen, rows.coarseness**2 * values, 0.0),
        rows.sum_of_squares,
        rows.redundancy,
    )
    return np.asarray(along_squared.sum(axis=1)), evidences


HIGHEST_HARMONIC = 60


def harmonic_bank(rows: ObservationEquations, lowest_order: int = 1) -> Bank:
    """Compute cos and sin of order times the reading, for every joint and order.

    Joint by joint, from the lowest order (1 is the eccentricity) upwards; whitened, in
    units of plausible amplitudes, (n_rows, 2 * n_orders * n_joints).
    """
    orders = np.arange(lowest_order, HIGHEST_HARMONIC + 1)
    candidates = tuple(
        _candidate(joint, order)
        for joint in rows.adjustment.network.campaign.joint_names
        for order in orders.tolist()
    )
    scales = np.array([candidate.scales for candidate in candidates[: len(orders)]])
    phases_rad = rows.block.angles_rad[:, :, np.newaxis] * orders
    waves = np.stack([np.cos(phases_rad), np.sin(phases_rad)], axis=3) * scales
    columns = rows.by_readings[:, :, np.newaxis, np.newaxis] * waves[rows.poses]
    return Bank(candidates, rows.decorrelated(columns.reshape(len(columns), -1)))


def _candidate(joint: str, order: int) -> Candidate:
    kind = EncoderEccentricity.kind if order == 1 else EncoderHarmonic.kind
    scale_rad = EFFECT_KINDS[kind].plausible_size(order)
    fixed = {"order": None if order == 1 else order}
    return candidate_of_kind(BankName.HARMONIC, kind, joint, fixed, scale_rad)
