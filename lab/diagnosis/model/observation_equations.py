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
from scipy.linalg import (  # type: ignore[import-untyped] # scipy ships no types
    solve_triangular,
)

from traverse.arrays import Floats, Integers
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.pose import angle_corrections
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.identification.equations.datum import undetermined_scale
from traverse.lab.identification.equations.network import (
    each_tool,
    white_rows,
)
from traverse.lab.identification.solve.adjustment import Adjustment, certified

# Combinations of unknowns, in units of what is plausible, that move the data by less
# than this part of their noise do not count as estimated.
LEAST_EFFECT = 0.02


@dataclass(frozen=True, eq=False)
class ObservationEquations:
    """All equations of a fit.

    Attributes:
        poses: The campaign's pose of every row; -1: a certificate, (n_rows,).
        values: Less the whitened misclosures, (n_rows,).
        by_centre: How rows change with the model's ball centre [1/mm], (n_rows, 3);
            zero for certificates.
        sources: How rows change with the readings, a seat's contact in x, y, z and a
            surface's along its normal, in units of their noise, (n_rows, n_joints + 4);
            zero for certificates.
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
    sources: Floats
    columns: Floats
    basis: Floats
    certificates: tuple[tuple[int, str, float], ...]
    root: Floats | None = None

    @property
    def redundancy(self) -> int:
        """Rows less unknowns."""
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
        found: Floats = -np.einsum("ri,rik->rk", self.by_centre, by_angles[self.poses])
        return found

    def each_tool(self, compute: Callable[[Geometry, Integers], Floats]) -> Floats:
        """As `network.each_tool`, of the fit's arm and all poses of the campaign."""
        poses = self.adjustment.network.campaign.poses
        return each_tool(poses, self.adjustment.state.arm, compute)

    def angles_rad(self, geometry: Geometry, at: Integers) -> Floats:
        """Compute the joints' angles of some poses by the fit, (n, n_joints)."""
        network, block = self.adjustment.network, self.block.part(at)
        effects = network.parameters.effects
        if effects is None:
            return block.angles_rad
        values = self.adjustment.state.arm.amplitudes
        errors_rad = angle_corrections(geometry, effects.at(values), block)
        return block.angles_rad - errors_rad

    def moved(self, moves: Floats) -> Floats:
        """Turn moves of the model's centres into changes of values, not yet projected.

        From mm per unit of each column, of every pose of the campaign, (n_poses, 3,
        n_columns), to C, (n_rows, n_columns).
        """
        return self.decorrelated(
            np.einsum("ri,rik->rk", self.by_centre, moves[self.poses])
        )

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
        found: Floats = solve_triangular(self.root, columns, lower=True)
        return found

    def project(self, columns: Floats) -> Floats:
        """Take out what the unknowns absorb, (n_rows, n_columns)."""
        return columns - self.basis @ (self.basis.T @ columns)


def equations_of(adjustment: Adjustment) -> ObservationEquations:
    """Set up the rows of a fit, where it ended."""
    network, state = adjustment.network, adjustment.state
    parameters = network.parameters
    n_free = parameters.n_free
    n_unknowns = sum(len(station.scales) for station in network.stations)
    parts: list[tuple[Floats, Floats, Integers, Floats, Floats]] = []
    certificates: list[tuple[int, str, float]] = []
    n_sources = parameters.n_joints + 4
    first, n_rows = n_free, 0
    for station, unknowns, corrections in zip(
        network.stations, state.unknowns, state.corrections, strict=True
    ):
        own = slice(first, first + len(station.scales))
        first = own.stop
        for rows in white_rows(network, station, state.arm, unknowns, corrections):
            n_poses, n_each = rows.misclosures.shape
            columns = np.zeros((n_poses * n_each, n_free + n_unknowns))
            columns[:, :n_free] = rows.by_parameters.reshape(-1, n_free)
            columns[:, own] = rows.by_unknowns.reshape(n_poses * n_each, -1)
            columns[:, own] *= station.scales
            by_centre = rows.by_centre.reshape(-1, 3)
            poses = np.repeat(station.poses[rows.part], n_each)
            sources = _sources(rows.by_readings, rows.by_contact)
            values = -rows.misclosures.ravel()
            parts.append((values, columns, poses, by_centre, sources))
            n_rows += len(poses)
        found = certified(network, station, state.arm, unknowns)
        lengths = station.artefact.lengths(unknowns)
        certificate = station.artefact.certificate(unknowns, station.touches)
        for length in lengths:
            row = length.certificate_row
            if row is not None:
                size_mm = length.value_mm - float(certificate.misclosures_mm[row])
                # Longer than certified: the certificate's misclosure falls.
                change = -size_mm / float(certificate.std_mm[row])
                certificates.append((n_rows + row, station.artefact.id, change))
        columns = np.zeros((len(found), n_free + n_unknowns))
        columns[:, own] = found[:, : len(station.scales)] * station.scales
        columns[:, :n_free] = found[:, len(station.scales) : -1]
        # The right side of an adjustment is less the misclosure already.
        no_poses = np.full(len(found), -1, dtype=np.int64)
        nothing = np.zeros((len(found), 3)), np.zeros((len(found), n_sources))
        parts.append((found[:, -1], columns, no_poses, *nothing))
        n_rows += len(found)
    values, columns, poses, by_centre, sources = (
        np.concatenate(part) for part in zip(*parts, strict=True)
    )
    columns[:, :n_free] *= parameters.free_tolerances
    # An undetermined scale was held by the fit. Misclosures grow with the arm, though:
    # left in, its column would pass for them and absorb them.
    stretch = undetermined_scale(network, state.arm)
    columns[:, :n_free] -= columns[:, :n_free] @ stretch.T @ stretch
    return ObservationEquations(
        adjustment=adjustment,
        poses=poses,
        values=values,
        by_centre=by_centre,
        sources=sources,
        columns=columns,
        basis=orthonormal_basis(columns),
        certificates=tuple(certificates),
    )


def _sources(by_readings: Floats, by_contact: Floats) -> Floats:
    """Put the sources of noise of some poses side by side, (n_rows, n_joints + 4).

    A hand that presses harder for a while is off along every surface's own normal.
    """
    n_poses, n_each, n_joints = by_readings.shape
    found = np.zeros((n_poses * n_each, n_joints + 4))
    found[:, :n_joints] = by_readings.reshape(-1, n_joints)
    if n_each == 1:
        found[:, -1] = np.linalg.norm(by_contact[:, 0], axis=1)
    else:
        found[:, n_joints:-1] = by_contact.reshape(-1, 3)
    return found


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
