"""The condition equations of a fit, whitened and linearised, free of its unknowns.

Around the fit, with d the unknowns (arm, terms, artefacts) and nabla what the model
lacks,

    values = A d + C nabla + e,    e ~ N(0, s^2 I)

`basis` spans A, so that P = I - basis basis^T is the projector on what the unknowns
cannot absorb (diagnosis by Baarda and Teunissen: everything is tested on P values).
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
            lambda geometry, chosen: (
                probe_derivatives(geometry, self.angles_rad(geometry, chosen)).by_angles
            )
        )
        changes: Floats = -np.einsum(
            "ri,rik->rk", self.by_centre, by_angles[self.poses]
        )
        if self.has_turns:
            turned = self.each_tool(
                lambda geometry, chosen: turn_derivatives(
                    geometry,
                    probe_derivatives(geometry, self.angles_rad(geometry, chosen)),
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

    def angles_rad(self, geometry: Geometry, chosen: Integers) -> Floats:
        """Compute the joints' angles of some poses by the fit, (n, n_joints)."""
        network, block = self.adjustment.network, self.block.part(chosen)
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
