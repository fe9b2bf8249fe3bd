"""Harmonics of every joint over a whole stream, in bounded memory.

With A the unknowns' columns and c a harmonic's two, all samples give

    M = c^T c - c^T A (A^T A)^-1 A^T c,    g = c^T v - c^T A (A^T A)^-1 A^T v
    T = g^T M^-1 g

Sums are gathered part by part. The columns of A are in the directions that the fit
of the thinned poses determines, in which A^T A is near a multiple of the identity, so
that nothing is lost by summing squares.

Errors of neighbouring samples are correlated, so T is larger than chi-square by what
the noise has too much at the harmonic's frequency: as much as the median over all
joints and the orders nearby says.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.lab.adjustment import Adjustment
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.diagnosis.candidates.library import HIGHEST_ORDER
from traverse.lab.diagnosis.candidates.waves import HIGHEST_HARMONIC, harmonic_bank
from traverse.lab.diagnosis.model.observation_equations import (
    LEAST_EFFECT,
    ObservationEquations,
)
from traverse.lab.diagnosis.scans.decimation import undecimated
from traverse.lab.outcomes.candidate import Candidate

# What unknowns leave of a harmonic, of its square, below which it is undetectable.
_LEAST_LEFT = 1e-6
_ORDERS_NEARBY = 8
_MEDIAN_OF_CHI2 = 2.0 * float(np.log(2.0))


@dataclass(frozen=True, slots=True)
class HarmonicFinding:
    """A harmonic as estimated from a whole stream.

    Attributes:
        std_rad: Of both together, root mean square, noise as it was found.
        statistic: T over what noise has too much: chi-square of two degrees.
    """

    candidate: Candidate
    amplitudes_rad: tuple[float, float]
    std_rad: float
    statistic: float

    @property
    def log_p(self) -> float:
        """Natural logarithm of the p-value."""
        return -0.5 * self.statistic


def stream_harmonics(
    rows: ObservationEquations, campaign: Campaign
) -> tuple[HarmonicFinding, ...]:
    """Test all harmonics on all samples: the most significant first."""
    sums = _gathered(rows, undecimated(rows.adjustment, campaign))
    squares, turns = np.linalg.eigh(sums.gram)
    seen = squares > _LEAST_LEFT * squares[-1]
    root = turns[:, seen] / np.sqrt(squares[seen])
    waves = np.einsum("us,kuhw->kshw", root, sums.by_unknowns)
    values = root.T @ sums.unknowns_by_values
    left = sums.squares - np.einsum("kshw,kshx->khwx", waves, waves)
    along = sums.by_values - np.einsum("kshw,s->khw", waves, values)
    n_joints, n_orders = along.shape[:2]
    parts, axes = np.linalg.eigh(left)
    sizes = np.maximum(np.einsum("khww->kh", sums.squares), 1e-300)
    parts[parts[:, :, 0] <= _LEAST_LEFT * sizes] = np.nan  # undetectable
    turned = np.einsum("khwp,khw->khp", axes, along)
    statistics = np.sum(turned**2 / parts, axis=2)
    amplitudes = np.einsum("khwp,khp->khw", axes, turned / parts)
    variances = np.mean(1.0 / parts, axis=2)
    excess = _excess(statistics)
    candidates = harmonic_bank(rows).candidates
    findings = [
        HarmonicFinding(
            candidate=candidates[joint * n_orders + order],
            amplitudes_rad=tuple(amplitudes[joint, order].tolist()),
            std_rad=float(np.sqrt(variances[joint, order] * excess[order])),
            statistic=float(statistics[joint, order] / excess[order]),
        )
        for joint, order in np.ndindex(n_joints, n_orders)
        if np.isfinite(statistics[joint, order])
    ]
    return tuple(sorted(findings, key=lambda finding: -finding.statistic))


def first_significant(
    findings: tuple[HarmonicFinding, ...], level: float
) -> HarmonicFinding | None:
    """Take the most significant harmonic beyond the library's orders.

    The level is the probability of a false alarm of the whole bank.
    """
    high = [
        harmonic
        for harmonic in findings
        if (harmonic.candidate.order or 0) > HIGHEST_ORDER
    ]
    if not high:
        return None
    first = max(high, key=lambda finding: finding.statistic)
    return first if first.log_p < np.log(level / len(high)) else None


@dataclass(slots=True)
class _Sums:
    """Accumulated sums; k joints, u directions of unknowns, h orders, w = cos, sin.

    Attributes:
        gram: A^T A, (u, u).
        unknowns_by_values: A^T v, (u,).
        by_unknowns: A^T c, (k, u, h, w).
        squares: c^T c, (k, h, w, w).
        by_values: c^T v, (k, h, w).
    """

    gram: Floats
    unknowns_by_values: Floats
    by_unknowns: Floats
    squares: Floats
    by_values: Floats


def _gathered(rows: ObservationEquations, every: Adjustment) -> _Sums:
    network, state = every.network, every.state
    _, values, right = np.linalg.svd(rows.columns, full_matrices=False)
    kept = values > LEAST_EFFECT
    directions = right[kept].T / values[kept]
    n_joints, n_seen = network.parameters.n_joints, directions.shape[1]
    sums = _Sums(
        np.zeros((n_seen, n_seen)),
        np.zeros(n_seen),
        np.zeros((n_joints, n_seen, HIGHEST_HARMONIC, 2)),
        np.zeros((n_joints, HIGHEST_HARMONIC, 2, 2)),
        np.zeros((n_joints, HIGHEST_HARMONIC, 2)),
    )
    places = rows.adjustment.network.unknown_columns
    n_free = network.parameters.n_free
    of_arm = directions[:n_free] * network.parameters.free_tolerances[:, np.newaxis]
    for station, of_station, unknowns in zip(
        network.stations, places, state.unknowns, strict=True
    ):
        of_unknowns = directions[of_station]
        of_unknowns = of_unknowns * station.scales[:, np.newaxis]
        for part in network.white_rows(station, state.arm, unknowns):
            columns = part.by_parameters @ of_arm + part.by_unknowns @ of_unknowns
            angles_rad = network.campaign.poses.angles_rad[station.poses[part.part]]
            # A reading that is too large by d_alpha: the corrected one is smaller.
            by_angles = -part.by_readings / network.noise.encoder_rad
            _add(sums, columns, -part.misclosures, angles_rad, by_angles)
        # Certificates hold lengths, as often as there are samples for each pose.
        certificates = network.certified(station, state.arm, unknowns)
        n_own = len(station.scales)
        columns = (
            certificates[:, :n_own] @ of_unknowns + certificates[:, n_own:-1] @ of_arm
        )
        sums.gram += columns.T @ columns
        sums.unknowns_by_values += columns.T @ certificates[:, -1]
    return sums


def _add(
    sums: _Sums, columns: Floats, values: Floats, angles_rad: Floats, by_angles: Floats
) -> None:
    """Add some samples."""
    flat = columns.reshape(-1, columns.shape[2])
    sums.gram += flat.T @ flat
    sums.unknowns_by_values += flat.T @ values.ravel()
    for joint in range(angles_rad.shape[1]):
        waves = _waves(angles_rad[:, joint])
        by_angle = by_angles[:, :, joint]
        together = np.einsum("nr,nru->nu", by_angle, columns)
        flat_waves = waves.reshape(len(waves), -1)
        products = (together.T @ flat_waves).reshape(-1, HIGHEST_HARMONIC, 2)
        sums.by_unknowns[joint] += products
        weights = np.sum(by_angle**2, axis=1)
        sums.squares[joint] += np.einsum("n,nhw,nhx->hwx", weights, waves, waves)
        sums.by_values[joint] += np.einsum(
            "n,nhw->hw", np.sum(by_angle * values, axis=1), waves
        )


def _waves(angles_rad: Floats) -> Floats:
    """Compute cos and sin of all orders, (n, HIGHEST_HARMONIC, 2), by powers."""
    turned = np.empty((HIGHEST_HARMONIC, len(angles_rad)), dtype=np.complex128)
    turned[0] = np.exp(1j * angles_rad)
    for order in range(1, HIGHEST_HARMONIC):
        np.multiply(turned[order - 1], turned[0], out=turned[order])
    return np.stack([turned.real.T, turned.imag.T], axis=2)


def _excess(statistics: Floats) -> Floats:
    """Return by how much noise alone makes T too large at each order, (n_orders,)."""
    n_orders = statistics.shape[1]
    excess = np.ones(n_orders)
    for order in range(n_orders):
        first = max(order - _ORDERS_NEARBY, 0)
        near = statistics[:, first : order + _ORDERS_NEARBY + 1]
        if np.any(np.isfinite(near)):
            excess[order] = max(float(np.nanmedian(near)) / _MEDIAN_OF_CHI2, 1e-12)
    return excess
