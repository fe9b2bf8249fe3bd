"""Stations, and their condition equations: misclosures and derivatives, whitened.

A station is an artefact with the poses that touched it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from traverse.arrays import Booleans, Floats, Integers
from traverse.kinematics.effects.pose import (
    corrected_pose,
    corrected_readings,
    corrected_rotations,
)
from traverse.kinematics.model.derivatives import probe_derivatives, turn_derivatives
from traverse.kinematics.model.forward import body_rotations, probe_centre
from traverse.kinematics.model.quaternion import multiply, small_turn
from traverse.lab.adjustment.noise import Noise
from traverse.lab.adjustment.parameters import ArmValues, Parameters
from traverse.lab.artefacts.artefact import Artefact, Touches
from traverse.lab.campaign.campaign import Campaign


@dataclass(frozen=True, slots=True, eq=False)
class Station:
    """One artefact and the poses that touched it.

    Attributes:
        poses: Indices of the campaign's poses, (n_poses,).
        scales: Uninformative prior standard deviations of its unknowns, (n_unknowns,).
    """

    artefact: Artefact
    index: int
    poses: Integers
    touches: Touches
    scales: Floats

    @property
    def n_rows(self) -> int:
        n_oriented = int(np.count_nonzero(self.touches.oriented))
        return len(self.poses) * self.artefact.rows_per_pose + 3 * n_oriented

    @property
    def most_rows(self) -> int:
        """The number of condition equations that a pose has at most."""
        is_oriented = self.touches.orientations is not None
        return self.artefact.rows_per_pose + (3 if is_oriented else 0)

    def part(self, rows: Integers) -> "Station":
        return replace(self, poses=self.poses[rows], touches=self.touches.part(rows))


def sorted_stations(
    campaign: Campaign, radius_mm: float, included: Booleans
) -> tuple[Station, ...]:
    """Sort the included poses by artefact, by tool, and orientations behind the others.

    Artefacts without any are left out.
    """
    poses = campaign.poses
    tools = np.zeros(len(poses)) if poses.tools is None else poses.tools
    order = np.lexsort((poses.oriented, tools, poses.artefacts))
    order = order[included[order]]
    indices = poses.artefacts[order]
    stations = []
    for index, artefact in enumerate(campaign.artefacts):
        first, last = np.searchsorted(indices, (index, index + 1))
        if first == last:
            continue
        mine = order[first:last]
        touches = campaign.touches(index, mine, radius_mm)
        scales = artefact.unknown_scales(touches)
        stations.append(Station(artefact, index, mine, touches, scales))
    return tuple(stations)


_CHUNK_POSES = 2048


@dataclass(frozen=True, slots=True, eq=False)
class WhiteRows:
    """Linearised equations of some poses, whitened: L^-1 ..., n_rows (1 or 3) a pose.

    Poses with an orientation have three rows more, in rad, behind those in mm.

    Attributes:
        part: Which poses of the station.
        misclosures: (n_poses, n_rows).
        by_unknowns: (n_poses, n_rows, n_unknowns).
        by_parameters: (n_poses, n_rows, n_free).
        by_centre: By the ball's centre, (n_poses, n_rows, 3) [1/mm].
        by_turn: By a small turn of the last body, (n_poses, n_rows, 3) [1/rad]; of
            poses with orientations, else None.
        by_readings: By readings in units of their noise, (n_poses, n_rows, n_joints).
        by_contact: By contacts, and orientations as measured, in units of their noise,
            (n_poses, n_rows, 3 or 6).
        whiteners: L^-1, (n_poses, n_rows, n_rows).
        unweighted: Misclosures as they are, (n_poses, n_rows).
        offsets: B v of the corrections v that were put in, (n_poses, n_rows).
        corrections: That follow, (n_poses, n_joints + 3 or 6).
    """

    part: slice
    misclosures: Floats
    by_unknowns: Floats
    by_parameters: Floats
    by_centre: Floats
    by_turn: Floats | None
    by_readings: Floats
    by_contact: Floats
    whiteners: Floats
    unweighted: Floats
    offsets: Floats
    corrections: Floats

    @property
    def misclosures_mm(self) -> Floats:
        """As they are, without those of orientations, (n_poses, 1 or 3)."""
        return self.unweighted[:, :3]


@dataclass(frozen=True, slots=True, eq=False)
class _Chunk:
    """Some poses of a station, all with the same tool.

    Attributes:
        part: Which poses of the station.
        readings_rad: Corrected, (n_poses, n_joints).
        body_turns: Rotations of the last body, (4, n_poses), and of the instrument's
            probe on it; None: they have no orientations.
    """

    part: slice
    tool: int
    readings_rad: Floats
    centres_mm: Floats
    body_turns: Floats
    turns: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """Functional and stochastic model of the poses of a campaign.

    Attributes:
        radius_mm: Of the probe's ball.
        weights: Factors of the weights of all the campaign's poses, (n_poses,); all
            ones, but for a robust start.
    """

    campaign: Campaign
    radius_mm: float
    parameters: Parameters
    noise: Noise
    weights: Floats

    def white_rows(
        self,
        station: Station,
        arm: ArmValues,
        unknowns: Floats,
        corrections: Floats | None = None,
    ) -> Iterator[WhiteRows]:
        """Linearise and whiten a station's equations, a bounded part at a time.

        The misclosures of a pose have the dispersion B Q B^T: the readings' noise
        through dx/dalpha, and the contact's, both through dw/dx, and likewise for
        orientations: the readings turn the last body, too. Linearised at corrected
        observations l + v they are w(l + v) - B v; the corrections that follow from
        them are - Q B^T (B Q B^T)^-1 w.
        """
        noise, parameters = self.noise, self.parameters
        contact = np.full(3, float(noise.contact_mm[station.index]))
        by_size = {3: contact, 6: np.append(contact, np.full(3, noise.orientation_rad))}
        n_corrected = parameters.n_joints + max(station.most_rows, 3)
        for chunk in self._chunks(station, arm, corrections):
            part, geometry = chunk.part, arm.with_tool(chunk.tool).geometry
            derivatives = probe_derivatives(geometry, chunk.readings_rad)
            rows = station.poses[part]
            touches = station.touches.part(part)
            equations = station.artefact.equations(unknowns, chunk.centres_mm, touches)
            unweighted, by_pose = equations.misclosures_mm, equations.by_centre
            by_unknowns, by_angles = equations.by_unknowns, derivatives.by_angles
            poses = self.campaign.poses.part(rows)
            columns = parameters.columns(arm, derivatives, poses)
            if chunk.turns is not None:
                more = station.artefact.orientation_equations(
                    unknowns, chunk.turns, touches
                )
                unweighted = np.concatenate([unweighted, more.misclosures_rad], axis=1)
                by_pose = _side_by_side(by_pose, more.by_turn)
                by_unknowns = np.concatenate([by_unknowns, more.by_unknowns], axis=1)
                turned = turn_derivatives(arm.geometry, derivatives)[0]
                by_angles = np.concatenate([by_angles, turned], axis=1)
                turned = parameters.turn_columns(arm, derivatives, poses)
                columns = np.concatenate([columns, turned], axis=1)
            stds = by_size[by_pose.shape[2]]
            scales = np.append(noise.encoder_rad, stds)
            by_readings = by_pose @ (by_angles * noise.encoder_rad)
            by_contact = by_pose * stds
            plain = whiteners(by_readings, by_contact)
            offsets = np.zeros_like(unweighted)
            sources = np.concatenate([by_readings, by_contact], axis=2)
            if corrections is not None:
                in_noise = (corrections[part, : len(scales)] / scales)[:, :, np.newaxis]
                offsets = (sources @ in_noise)[:, :, 0]
            misclosures = unweighted - offsets
            weighed = (
                plain.swapaxes(1, 2) @ _times(plain, misclosures)[:, :, np.newaxis]
            )
            following = -(sources.swapaxes(1, 2) @ weighed)[:, :, 0] * scales
            if len(scales) < n_corrected:
                following = np.pad(following, ((0, 0), (0, 3)))
            roots = np.sqrt(self.weights[rows])[:, np.newaxis, np.newaxis]
            whitener = roots * plain
            white_by_pose = whitener @ by_pose
            yield WhiteRows(
                part=part,
                misclosures=_times(whitener, misclosures),
                by_unknowns=whitener @ by_unknowns,
                by_parameters=white_by_pose @ columns,
                by_centre=white_by_pose[:, :, :3],
                by_turn=None if chunk.turns is None else white_by_pose[:, :, 3:],
                by_readings=whitener @ by_readings,
                by_contact=whitener @ by_contact,
                whiteners=whitener,
                unweighted=misclosures,
                offsets=offsets,
                corrections=following,
            )

    def all_misclosures(
        self,
        station: Station,
        arm: ArmValues,
        unknowns: Floats,
        corrections: Floats | None = None,
    ) -> Floats:
        """Compute a station's misclosures alone, (n_poses, most_rows).

        In mm, and behind them of orientations in rad, zero where there is none.
        """
        centres_mm = self.centres_mm(station, arm, corrections)
        misclosures = np.zeros((len(centres_mm), station.most_rows))
        for first in range(0, len(centres_mm), _CHUNK_POSES):
            part = slice(first, first + _CHUNK_POSES)
            touches = station.touches.part(part)
            equations = station.artefact.equations(unknowns, centres_mm[part], touches)
            misclosures[part, : station.artefact.rows_per_pose] = (
                equations.misclosures_mm
            )
        if station.touches.orientations is not None:
            for chunk in self._chunks(station, arm, corrections):
                if chunk.turns is not None:
                    misclosures[chunk.part, 3:] = (
                        station.artefact.orientation_equations(
                            unknowns, chunk.turns, station.touches.part(chunk.part)
                        ).misclosures_rad
                    )
        return misclosures

    def misclosures_mm(
        self, station: Station, arm: ArmValues, unknowns: Floats
    ) -> Floats:
        """Compute a station's misclosures without those of orientations.

        (n_poses, rows_per_pose)
        """
        misclosures = self.all_misclosures(station, arm, unknowns)
        return misclosures[:, : station.artefact.rows_per_pose]

    def orientation_errors_rad(
        self, station: Station, arm: ArmValues, unknowns: Floats
    ) -> Floats:
        """Compute the misclosures of orientations, NaN without, (n_poses, 3) [rad]."""
        errors_rad = np.full((len(station.poses), 3), np.nan)
        oriented = station.touches.oriented
        if np.any(oriented):
            every = self.all_misclosures(station, arm, unknowns)
            errors_rad[oriented] = every[oriented, 3:]
        return errors_rad

    def centres_mm(
        self,
        station: Station,
        arm: ArmValues,
        corrections: Floats | None = None,
    ) -> Floats:
        """Compute the ball centres of a station's poses in mm, (n_poses, 3)."""
        chunks = self._chunks(station, arm, corrections)
        return np.concatenate([chunk.centres_mm for chunk in chunks])

    def _parts(self, station: Station) -> Iterator[tuple[int, slice]]:
        """Cut a station's poses where tool or kind change, and to a bounded size.

        The kind is whether there are orientations.
        """
        tools, n_poses = self.campaign.poses.tools, len(station.poses)
        ends = np.arange(0, n_poses, _CHUNK_POSES)[1:]
        if station.touches.orientations is not None:
            ends = np.union1d(
                ends, 1 + np.flatnonzero(np.diff(station.touches.oriented))
            )
        if tools is not None:
            ends = np.union1d(ends, 1 + np.flatnonzero(np.diff(tools[station.poses])))
        for first, last in pairwise((0, *ends.tolist(), n_poses)):
            tool = 0 if tools is None else int(tools[station.poses[first]])
            yield tool, slice(first, last)

    def _chunks(
        self, station: Station, values: ArmValues, corrections: Floats | None
    ) -> Iterator[_Chunk]:
        """Go through a station's poses."""
        poses, n = self.campaign.poses, self.parameters.n_joints
        oriented = station.touches.oriented
        for tool, part in self._parts(station):
            arm = values.with_tool(tool)
            rows = station.poses[part]
            angles_rad = poses.angles_rad[rows]
            if corrections is not None:
                angles_rad = angles_rad + corrections[part, :n]
            effects = self.parameters.effects
            is_oriented = len(rows) > 0 and bool(oriented[part][0])
            body_turns = np.empty((4, 0))
            if effects is None:
                centres_mm = probe_centre(arm.geometry, angles_rad)
                if is_oriented:
                    body_turns = body_rotations(arm.geometry, angles_rad)
            else:
                block = effects.campaign.block(poses.part(rows), angles_rad)
                sized = effects.at(arm.amplitudes)
                angles_rad = corrected_readings(arm.geometry, sized, block)
                centres_mm = corrected_pose(arm.geometry, sized, block)[0]
                if is_oriented:
                    body_turns = corrected_rotations(arm.geometry, sized, block)
            if corrections is not None:
                centres_mm = centres_mm + corrections[part, n : n + 3]
            turns = None
            if is_oriented:
                mounting = values.mountings[self.parameters.mounted.index(tool)]
                turns = multiply(body_turns, mounting[:, np.newaxis])
                if corrections is not None:
                    turns = multiply(small_turn(corrections[part, n + 3 :].T), turns)
            yield _Chunk(part, tool, angles_rad, centres_mm, body_turns, turns)


def whiteners(by_readings: Floats, by_contact: Floats) -> Floats:
    """Compute L^-1 of many small dispersions, in closed form.

    From derivatives by readings times their standard deviations, (n_poses, n_rows,
    n_joints), with n_rows 1, 3 or 6, and the same by the other sources, (n_poses,
    n_rows, 3 or 6). Lower triangles, (n_poses, n_rows, n_rows).
    """
    noise = np.concatenate([by_readings, by_contact], axis=2)
    if noise.shape[1] == 1:
        variances = np.einsum("nij,nij->ni", noise, noise)
        factors: Floats = 1.0 / np.sqrt(variances)[:, :, np.newaxis]
        return factors
    dispersion = noise @ noise.swapaxes(1, 2)
    if noise.shape[1] > 3:
        # Exactly zero above: what a position says does not depend on its orientation.
        return np.tril(np.linalg.inv(np.linalg.cholesky(dispersion)))
    return _inverse_factors(dispersion)


def _inverse_factors(matrices: Floats) -> Floats:
    """Invert the Cholesky factors of 3 x 3 matrices, (n, 3, 3)."""
    a = np.sqrt(matrices[:, 0, 0])
    b = matrices[:, 1, 0] / a
    c = matrices[:, 2, 0] / a
    d = np.sqrt(matrices[:, 1, 1] - b * b)
    e = (matrices[:, 2, 1] - b * c) / d
    f = np.sqrt(matrices[:, 2, 2] - c * c - e * e)
    inverse = np.zeros_like(matrices)
    inverse[:, 0, 0] = 1.0 / a
    inverse[:, 1, 1] = 1.0 / d
    inverse[:, 2, 2] = 1.0 / f
    inverse[:, 1, 0] = -b / (a * d)
    inverse[:, 2, 1] = -e / (d * f)
    inverse[:, 2, 0] = (b * e - c * d) / (a * d * f)
    return inverse


def _side_by_side(first: Floats, second: Floats) -> Floats:
    """Put matrices of each pose (n, 3, 3) on a diagonal, (n, 6, 6)."""
    both = np.zeros((len(first), 6, 6))
    both[:, :3, :3] = first
    both[:, 3:, 3:] = second
    return both


def _times(matrices: Floats, vectors: Floats) -> Floats:
    """Multiply (n, k, k) with (n, k)."""
    return (matrices @ vectors[:, :, np.newaxis])[:, :, 0]
