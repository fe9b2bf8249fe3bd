"""The same least-squares problem by `scipy.optimize.least_squares`.

Unknowns are the same steps of the arm's parameters and of the artefacts' unknowns,
from the same start. Residuals are the same misclosures, computed by the same vectorised
forward kinematics and whitened once for all at the start, which spares the peers that
work in every iteration.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import (  # type: ignore[import-untyped] # scipy ships no types
    least_squares,
)

from benchmarks.identification.problem import Problem
from traverse.arrays import Floats
from traverse.kinematics.model.derivatives import derivative_chunks
from traverse.lab.identification.equations.network import State, Station
from traverse.lab.identification.equations.station_equations import misclosures_mm
from traverse.lab.identification.solve.adjustment import linearise


@dataclass(frozen=True, slots=True, eq=False)
class PeerResult:
    """What a peer found.

    Attributes:
        state: The estimates.
        n_jacobians: Iterations.
    """

    state: State
    n_jacobians: int


class DensePeer:
    """A problem as scipy wants it: one vector in, one vector or dense matrix out."""

    def __init__(self, given: Problem) -> None:
        self._network, self._start = given.network, given.start
        self._whiteners = linearise(self._network, self._start).whiteners
        self._n_free = self._network.parameters.n_free
        widths = [len(station.scales) for station in self._network.stations]
        self._ends = self._n_free + np.concatenate([[0], np.cumsum(widths)])

    def solve(self, *, numerical: bool) -> PeerResult:
        """Minimise from the start.

        Args:
            numerical: Derivatives by differences, '2-point'; else analytic ones.
        """
        found = least_squares(
            self._residuals,
            np.zeros(self._ends[-1]),
            jac="2-point" if numerical else self._jacobian,
            x_scale="jac",
        )
        return PeerResult(self._state(found.x), int(found.njev))

    def _state(self, steps: Floats) -> State:
        arm = self._network.parameters.moved(self._start.arm, steps[: self._n_free])
        unknowns = tuple(
            station.artefact.moved(values, steps[first:last])
            for station, values, first, last in zip(
                self._network.stations,
                self._start.unknowns,
                self._ends[:-1],
                self._ends[1:],
                strict=True,
            )
        )
        return replace(self._start, arm=arm, unknowns=unknowns)

    def _residuals(self, steps: Floats) -> Floats:
        state = self._state(steps)
        found = []
        for station, unknowns, whiteners in zip(
            self._network.stations, state.unknowns, self._whiteners, strict=True
        ):
            rows_mm = misclosures_mm(self._network, station, state.arm, unknowns)
            found.append((whiteners @ rows_mm[:, :, np.newaxis]).ravel())
            certificate = station.artefact.certificate(unknowns, station.touches)
            found.append(certificate.misclosures_mm / certificate.std_mm)
        return np.concatenate(found)

    def _jacobian(self, steps: Floats) -> Floats:
        state = self._state(steps)
        blocks = []
        for at, station in enumerate(self._network.stations):
            own = slice(self._ends[at], self._ends[at + 1])
            unknowns = state.unknowns[at]
            blocks.append(self._station_block(at, station, state, own))
            certificate = station.artefact.certificate(unknowns, station.touches)
            rows = np.zeros((len(certificate.std_mm), self._ends[-1]))
            rows[:, own] = certificate.by_unknowns / certificate.std_mm[:, np.newaxis]
            blocks.append(rows)
        return np.vstack(blocks)

    def _station_block(
        self, at: int, station: Station, state: State, own: slice
    ) -> Floats:
        poses = self._network.campaign.poses
        parameters = self._network.parameters
        angles_rad = poses.angles_rad[station.poses]
        shape = (len(angles_rad), station.artefact.rows_per_pose, self._ends[-1])
        rows = np.zeros(shape)
        for part, derivatives in derivative_chunks(state.arm.geometry, angles_rad):
            equations = station.artefact.equations(
                state.unknowns[at], derivatives.centres_mm, station.touches.part(part)
            )
            # Steps are counted from the start, so its basis is the one to take.
            columns = parameters.columns(
                self._start.arm, derivatives, poses.part(station.poses[part])
            )
            whiteners = self._whiteners[at][part]
            rows[part, :, : self._n_free] = whiteners @ (equations.by_centre @ columns)
            rows[part, :, own] = whiteners @ equations.by_unknowns
        return rows.reshape(-1, self._ends[-1])
