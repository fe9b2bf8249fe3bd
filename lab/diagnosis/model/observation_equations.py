"""The condition equations of a fit, whitened and linearised, free of its unknowns.

Around the fit, with d the unknowns (arm, terms, artefacts) and nabla what the model
lacks,

    values = A d + C nabla + e,    e ~ N(0, s^2 I)

`basis` spans A, so that P = I - basis basis^T is the projector on what the unknowns
cannot absorb (diagnosis by Baarda and Teunissen: everything is tested on P values).

Readings and contacts drift a little during the day: a part `share` of their variance
then has the correlation phi^l between poses l apart, in the order of time. The rows'
errors have the correlation

    R_ij = (1 - share) delta_ij + share phi^|t_i - t_j| s_i . s_j

with s_i the row's sources in units of their noise. Who takes such noise for white takes
it for drifts.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import linalg

from traverse.arrays import Floats, Integers
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.pose import angle_corrections
from traverse.kinematics.model.derivatives import probe_derivatives, turn_derivatives
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.adjustment import Adjustment, Noise

# Combinations of unknowns, in units of what is plausible, that move the data by less
# than this part of their noise do not count as estimated.
LEAST_EFFECT = 0.02
# Of the readings: plausible sizes of effects are those of arms that read so finely.
_FINE_READING_RAD = 1e-5


@dataclass(frozen=True, eq=False)
class ObservationEquations:
    """All equations of a fit.

    Attributes:
        poses: The campaign's pose of every row; -1: of a certificate or of the arm's
            family, (n_rows,).
        values: Less the whitened misclosures, (n_rows,).
        by_centre: How rows change with the model's ball centre [1/mm], (n_rows, 3);
            zero for certificates.
        by_turn: And with a small turn of the last body [1/rad], (n_rows, 3); zero but
            for measured orientations.
        sources: How rows change with the readings, a seat's contact in x, y, z, a
            surface's along its normal, and an orientation as measured about x, y, z, in
            units of their noise, (n_rows, n_joints + 7); zero for certificates.
        columns: A in units of plausible deviations, (n_rows, n_unknowns).
        basis: Orthonormal, of all unknowns' columns, (n_rows, rank).
        certificates: Rows of artefacts' lengths: row, artefact's id, change with a
            part of the length.
        root: Lower Cholesky factor of the correlation of the rows' errors, or None.
    """

    adjustment: Adjustment
    poses: Integers
    values: Floats
    by_centre: Floats
    by_turn: Floats
    sources: Floats
    columns: Floats
    basis: Floats
    certificates: tuple[tuple[int, str, float], ...]
    root: Floats | None = None

    @property
    def coarseness(self) -> float:
        """How much larger effects of this arm plausibly are than the table says."""
        return coarseness(self.adjustment.network.noise)

    @property
    def redundancy(self) -> int:
        return len(self.values) - int(self.basis.shape[1])

    @cached_property
    def residuals(self) -> Floats:
        """P values, (n_rows,)."""
        return self.project(self.values[:, np.newaxis])[:, 0]

    @cached_property
    def sum_of_squares(self) -> float:
        """T_0: of the residuals."""
        return float(self.residuals @ self.residuals)

    @cached_property
    def block(self) -> Block:
        """All poses of the campaign as effects see them."""
        return self.adjustment.network.campaign.block()

    @cached_property
    def used_poses(self) -> Integers:
        """The campaign's poses that take part, in rising order, (n_used,)."""
        return np.unique(self.poses[self.poses >= 0])

    @cached_property
    def by_readings(self) -> Floats:
        """How rows change with d_alpha = 1 rad of each joint, (n_rows, n_joints).

        What is made of it is still to be decorrelated.
        """
        by_angles = self.each_tool(
            lambda geometry, at: (
                probe_derivatives(geometry, self.angles_rad(geometry, at)).by_angles
            )
        )
        changes: Floats = -np.einsum(
            "ri,rik->rk", self.by_centre, by_angles[self.poses]
        )
        if self.has_turns:
            turned = self.each_tool(
                lambda geometry, at: turn_derivatives(
                    geometry,
                    probe_derivatives(geometry, self.angles_rad(geometry, at)),
                )[0]
            )
            changes -= np.einsum("ri,rik->rk", self.by_turn, turned[self.poses])
        return changes

    @cached_property
    def has_turns(self) -> bool:
        return bool(np.any(self.by_turn))

    def each_tool(self, compute: Callable[[Geometry, Integers], Floats]) -> Floats:
        """As `ArmValues.each_tool`, of the fit's arm and all poses of the campaign."""
        poses = self.adjustment.network.campaign.poses
        return self.adjustment.state.arm.each_tool(poses, compute)

    def angles_rad(self, geometry: Geometry, at: Integers) -> Floats:
        """Compute the joints' angles of some poses by the fit, (n, n_joints)."""
        network, block = self.adjustment.network, self.block.part(at)
        effects = network.parameters.effects
        if effects is None:
            return block.angles_rad
        values = self.adjustment.state.arm.amplitudes
        errors_rad = angle_corrections(geometry, effects.at(values), block)
        return block.angles_rad - errors_rad

    def moved(self, moves: Floats, turns: Floats | None = None) -> Floats:
        """Turn moves of the model into changes of values, not yet projected.

        From mm, and turns of the last body in rad where orientations were measured, per
        unit of each column, of every pose of the campaign, (n_poses, 3, n_columns)
        each, to C, (n_rows, n_columns).
        """
        changes: Floats = np.einsum("ri,rik->rk", self.by_centre, moves[self.poses])
        if turns is not None:
            changes += np.einsum("ri,rik->rk", self.by_turn, turns[self.poses])
        return self.decorrelated(changes)

    def by_artefact_length(self, artefact: str) -> Floats:
        """Compute the change where a standard is 1 ppm longer, (n_rows, 1)."""
        column = np.zeros((len(self.values), 1))
        for row, of, change in self.certificates:
            if of == artefact:
                column[row] = 1e-6 * change
        return self.decorrelated(column)

    def decorrelated(self, columns: Floats) -> Floats:
        """Take serial correlation out of columns that do not know of it yet."""
        if self.root is None:
            return columns
        solved: Floats = linalg.solve_triangular(self.root, columns, lower=True)
        return solved

    def project(self, columns: Floats) -> Floats:
        """Take out what the unknowns absorb, (n_rows, n_columns)."""
        return columns - self.basis @ (self.basis.T @ columns)


def coarseness(noise: Noise) -> float:
    """Return how much larger effects plausibly are than the effect table says.

    Strategy: the table has sizes of arms that measure to micrometres. An arm with
    encoders of 0.5 mrad has eccentricities of some mrad; priors of 30 microradians
    would call those impossible, and whatever has more parameters to share the size
    among wins. What an arm is made of is as coarse as what it reads with, so all sizes
    grow with the noise of the readings, stated or estimated.
    """
    typical_rad = float(np.median(noise.encoder_rad))
    return max(typical_rad / _FINE_READING_RAD, 1.0)


def equations_of(adjustment: Adjustment) -> ObservationEquations:
    """Set up the rows of a fit, where it ended."""
    network, state = adjustment.network, adjustment.state
    parameters = network.parameters
    n_free = parameters.n_free
    n_columns = n_free + sum(len(station.scales) for station in network.stations)
    parts: list[tuple[Floats, Floats, Integers, Floats, Floats, Floats]] = []
    certificates: list[tuple[int, str, float]] = []
    n_sources = parameters.n_joints + 7
    n_rows = 0
    for station, of_station, unknowns, corrections in zip(
        network.stations,
        network.unknown_columns,
        state.unknowns,
        state.corrections,
        strict=True,
    ):
        for rows in network.white_rows(station, state.arm, unknowns, corrections):
            n_poses, n_each = rows.misclosures.shape
            columns = np.zeros((n_poses * n_each, n_columns))
            columns[:, :n_free] = rows.by_parameters.reshape(-1, n_free)
            columns[:, of_station] = rows.by_unknowns.reshape(n_poses * n_each, -1)
            columns[:, of_station] *= station.scales
            by_centre = rows.by_centre.reshape(-1, 3)
            by_turn = np.zeros_like(by_centre)
            if rows.by_turn is not None:
                by_turn = rows.by_turn.reshape(-1, 3)
            poses = np.repeat(station.poses[rows.part], n_each)
            sources = _sources(rows.by_readings, rows.by_contact)
            values = -rows.misclosures.ravel()
            parts.append((values, columns, poses, by_centre, by_turn, sources))
            n_rows += len(poses)
        certificate_rows = network.certified(station, state.arm, unknowns)
        lengths = station.artefact.lengths(unknowns)
        certificate = station.artefact.certificate(unknowns, station.touches)
        for length in lengths:
            row = length.certificate_row
            if row is not None:
                size_mm = length.value_mm - float(certificate.misclosures_mm[row])
                # Longer than certified: the certificate's misclosure falls.
                change = -size_mm / float(certificate.std_mm[row])
                certificates.append((n_rows + row, station.artefact.id, change))
        columns = np.zeros((len(certificate_rows), n_columns))
        columns[:, of_station] = (
            certificate_rows[:, : len(station.scales)] * station.scales
        )
        columns[:, :n_free] = certificate_rows[:, len(station.scales) : -1]
        # The right side of an adjustment is less the misclosure already.
        parts.append(
            (
                certificate_rows[:, -1],
                columns,
                *_of_no_pose(len(certificate_rows), n_sources),
            )
        )
        n_rows += len(certificate_rows)
    expected = parameters.expectations(state.arm)
    columns = np.zeros((len(expected), n_columns))
    columns[:, :n_free] = expected[:, :-1]
    parts.append((expected[:, -1], columns, *_of_no_pose(len(expected), n_sources)))
    values, columns, poses, by_centre, by_turn, sources = (
        np.concatenate(part) for part in zip(*parts, strict=True)
    )
    columns[:, :n_free] *= parameters.free_tolerances
    # An undetermined scale was held by the fit. Misclosures grow with the arm, though:
    # left in, its column would pass for them and absorb them.
    stretch = network.undetermined_scale(state.arm)
    columns[:, :n_free] -= columns[:, :n_free] @ stretch.T @ stretch
    return ObservationEquations(
        adjustment=adjustment,
        poses=poses,
        values=values,
        by_centre=by_centre,
        by_turn=by_turn,
        sources=sources,
        columns=columns,
        basis=orthonormal_basis(columns),
        certificates=tuple(certificates),
    )


def _of_no_pose(n_rows: int, n_sources: int) -> tuple[Integers, Floats, Floats, Floats]:
    """Return poses, changes by centre, turn and sources of rows that have none."""
    nothing, no_sources = np.zeros((n_rows, 3)), np.zeros((n_rows, n_sources))
    return np.full(n_rows, -1, dtype=np.int64), nothing, nothing, no_sources


def _sources(by_readings: Floats, by_contact: Floats) -> Floats:
    """Put the sources of noise of some poses side by side, (n_rows, n_joints + 7).

    A hand that presses harder for a while is off along every surface's own normal.
    """
    n_poses, n_each, n_joints = by_readings.shape
    sources = np.zeros((n_poses * n_each, n_joints + 7))
    sources[:, :n_joints] = by_readings.reshape(-1, n_joints)
    if n_each == 1:
        sources[:, n_joints + 3] = np.linalg.norm(by_contact[:, 0], axis=1)
        return sources
    sources[:, n_joints : n_joints + 3] = by_contact[:, :, :3].reshape(-1, 3)
    if n_each > 3:
        sources[:, n_joints + 4 :] = by_contact[:, :, 3:].reshape(-1, 3)
    return sources


def orthonormal_basis(columns: Floats) -> Floats:
    """Find an orthonormal basis of what columns do to the data, (n_rows, rank)."""
    left, values, _ = np.linalg.svd(columns, full_matrices=False)
    return left[:, values > LEAST_EFFECT]


def decorrelated_equations(
    rows: ObservationEquations, root: Floats
) -> ObservationEquations:
    """Take serial correlation into account, by the lower Cholesky factor of it."""
    whitened = replace(rows, root=root)
    columns = whitened.decorrelated(rows.columns)
    values = whitened.decorrelated(rows.values[:, np.newaxis])[:, 0]
    return replace(
        whitened, values=values, basis=orthonormal_basis(columns), columns=columns
    )


_MOST_LAG = 25
_TEST_PHI = 0.9
_PHIS = (0.7, 0.8, 0.9, 0.95, 0.98)
_LARGEST_SHARE = 0.9
_LIKELY_SHARES = (0.2, 0.35, 0.5)


@dataclass(frozen=True, slots=True)
class SerialCorrelation:
    """Correlated part of the noise: share of its variance, phi from pose to pose."""

    share: float
    phi: float


def is_serially_correlated(
    rows: ObservationEquations, draws: Floats, level: float
) -> bool:
    """Test residuals for serial correlation.

    Against draws of the residuals of white noise, (n_rows, n_draws).
    """
    weights = _TEST_PHI ** np.arange(1, _MOST_LAG + 1)
    many = np.column_stack([rows.residuals, draws])
    products, _ = _lagged(rows, many)
    correlations = weights @ products / np.einsum("rd,rd->d", many, many)
    return bool(correlations[0] > np.quantile(correlations[1:], 1.0 - level))


def serial_correlation(rows: ObservationEquations) -> SerialCorrelation:
    """Estimate share and correlation from the products of residuals at every lag."""
    residuals = rows.residuals[:, np.newaxis]
    products, weights = _lagged(rows, residuals)
    variance = rows.sum_of_squares / rows.redundancy
    best, least = SerialCorrelation(0.0, 0.0), np.inf
    lags = np.arange(1, _MOST_LAG + 1)
    for phi in _PHIS:
        model = weights * phi**lags
        share = float(products[:, 0] @ phi**lags / variance / (model @ phi**lags))
        share = float(np.clip(share, 0.0, _LARGEST_SHARE))
        correlations = products[:, 0] / variance / np.maximum(weights, 1e-12)
        misfit = float(np.sum(weights * (correlations - share * phi**lags) ** 2))
        if misfit < least:
            best, least = SerialCorrelation(share, phi), misfit
    return best


def likeliest_serial_noise(
    rows: ObservationEquations,
) -> tuple[SerialCorrelation, float]:
    """Find the likeliest serial noise, and its `serial_evidence`.

    Strategy: the unknowns absorb a part of what is slow, which products of residuals do
    not know of, but the restricted likelihood does. Each of its values costs as much as
    a fit of dense rows, and it is flat in the share, so that few are tried.
    """
    least, middle, largest = _LIKELY_SHARES
    evidences = {
        noise: serial_evidence(rows, noise)
        for noise in (SerialCorrelation(middle, phi) for phi in _PHIS)
    }
    phi = max(evidences, key=lambda noise: evidences[noise]).phi
    for share in (least, largest):
        noise = SerialCorrelation(share, phi)
        evidences[noise] = serial_evidence(rows, noise)
    return max(evidences.items(), key=lambda pair: pair[1])


def without_serial_noise(
    rows: ObservationEquations, noise: SerialCorrelation
) -> ObservationEquations:
    """Whiten rows whose noise is correlated from pose to pose."""
    return decorrelated_equations(rows, _root(rows, noise))


def serial_evidence(rows: ObservationEquations, noise: SerialCorrelation) -> float:
    """Compute by how much likelier serial noise makes rows than white noise does.

    The natural logarithm of the ratio of restricted likelihoods, each with the variance
    that fits best; B is the basis of the unknowns' columns:

        - 1/2 (log |R| + log |B^T R^-1 B| + n log(v^T R^-1/2 P_R R^-1/2 v / v^T P v))
    """
    root = _root(rows, noise)
    basis, triangle = np.linalg.qr(
        linalg.solve_triangular(root, rows.basis, lower=True)
    )
    values = linalg.solve_triangular(root, rows.values, lower=True)
    left = values - basis @ (basis.T @ values)
    log_determinant = 2.0 * float(
        np.sum(np.log(np.diag(root))) + np.sum(np.log(np.abs(np.diag(triangle))))
    )
    ratio = float(left @ left) / rows.sum_of_squares
    return -0.5 * (log_determinant + rows.redundancy * float(np.log(ratio)))


def _root(rows: ObservationEquations, noise: SerialCorrelation) -> Floats:
    """Factor the correlation of rows, lower triangle."""
    order = _order(rows)
    apart = np.abs(order[:, np.newaxis] - order[np.newaxis, :])
    correlation = noise.share * noise.phi**apart * (rows.sources @ rows.sources.T)
    at = np.arange(len(order))
    correlation[at, at] += 1.0 - noise.share
    certified = rows.poses < 0
    correlation[certified, :] = 0.0
    correlation[:, certified] = 0.0
    correlation[at[certified], at[certified]] = 1.0
    return np.linalg.cholesky(correlation)


def _order(rows: ObservationEquations) -> Integers:
    """Number the poses of all rows in the order of time, (n_rows,)."""
    times_s = rows.adjustment.network.campaign.poses.time_s
    used = rows.used_poses
    sorted_poses = used[np.argsort(times_s[used], kind="stable")]
    numbers = np.full(len(times_s) + 1, -1, dtype=np.int64)
    numbers[sorted_poses] = np.arange(len(sorted_poses))
    return numbers[rows.poses]


def rows_by_pose(numbers: Integers, values: Floats) -> Floats:
    """Sort rows by the number of their pose, below 0 none: (n_poses, 3 or 6, ...).

    A pose has up to three rows, with orientations six; absent ones are zero.
    """
    rows = np.flatnonzero(numbers >= 0)
    rows = rows[np.argsort(numbers[rows], kind="stable")]
    poses = numbers[rows]
    within = np.arange(len(rows)) - np.searchsorted(poses, poses)
    n_each = 6 if np.any(within >= 3) else 3
    by_pose = np.zeros((int(poses.max(initial=-1)) + 1, n_each, *values.shape[1:]))
    by_pose[poses, within] = values[rows]
    return by_pose


def _lagged(rows: ObservationEquations, residuals: Floats) -> tuple[Floats, Floats]:
    """Sum products of residuals, (n_rows, n_many), of poses some steps apart.

    For every lag, the sum of v_t^T K v_(t+l), (n_lags, n_many), with K the correlation
    that common sources would give, and the sum of squares of K.
    """
    order = _order(rows)
    values, sources = rows_by_pose(order, residuals), rows_by_pose(order, rows.sources)
    n_poses = len(values)
    products = np.zeros((_MOST_LAG, residuals.shape[1]))
    weights = np.zeros(_MOST_LAG)
    for lag in range(1, min(_MOST_LAG, n_poses - 1) + 1):
        common = sources[:-lag] @ sources[lag:].swapaxes(1, 2)
        products[lag - 1] = np.einsum(
            "tid,tid->d", values[:-lag], common @ values[lag:]
        )
        weights[lag - 1] = float(np.sum(common**2))
    return products, weights
