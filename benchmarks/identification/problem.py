"""Large simulated campaigns for timing: one set of poses, drawn again and again.

Postures repeat with other noise, which costs the adjustment as much as new ones.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import (
    least_squares,
)

from benchmarks.proofs.conditions import demo_arm
from benchmarks.tools.handover import campaign_from_simulation
from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.model.derivatives import derivative_chunks
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.lab.adjustment import ArmValues, Network
from traverse.lab.adjustment import Problem as Posed
from traverse.lab.adjustment.datum import with_datum
from traverse.lab.adjustment.equations import Station
from traverse.lab.adjustment.prepare import arm_parameters
from traverse.lab.adjustment.problem import State
from traverse.lab.adjustment.system import linearise
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.poses import Poses
from traverse.simulator.campaigns import CampaignSpec, draw_noise, make_poses

_MOST_DIFFERENT = 5000
_SCAN_RADIUS_MM = 40.0


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Start of every method.

    Attributes:
        start: the design, and the artefacts' unknowns that follow from it.
    """

    network: Network
    start: State


def large_campaign(kind: str, n_poses: int, seed: int = 1) -> Campaign:
    """Make a campaign.

    Args:
        kind: "mixed", five cones and a ball bar; or "scan", one sphere of known
            radius.
        n_poses: Of all artefacts; a multiple of 5 000 if larger than that.
        seed: Of the poses; draws count on from it.
    """
    n_draws = -(-n_poses // _MOST_DIFFERENT)
    n_different = n_poses // n_draws
    if n_different * n_draws != n_poses:
        raise ValueError(f"{n_poses} poses; expected a multiple of {_MOST_DIFFERENT}")
    ball = {"id": "ball", "kind": "sphere", "known": True, "n_poses": n_different}
    chosen: dict[str, object] = (
        {"mix": "cones+bar", "n_poses": n_different}
        if kind == "mixed"
        else {"artefacts": ({**ball, "radius_mm": _SCAN_RADIUS_MM},)}
    )
    spec = CampaignSpec.model_validate({**chosen, "conditions": {"columns": ()}})
    poses = make_poses(demo_arm(), spec, seed)
    drawn = [
        campaign_from_simulation(draw_noise(poses, seed + draw).campaign)
        for draw in range(n_draws)
    ]
    numbers = np.arange(n_poses)
    return replace(
        drawn[0],
        poses=Poses(
            lines=numbers + 2,
            time_s=numbers.astype(np.float64),
            artefacts=np.concatenate([part.poses.artefacts for part in drawn]),
            features=np.concatenate([part.poses.features for part in drawn]),
            angles_rad=np.concatenate([part.poses.angles_rad for part in drawn]),
        ),
    )


def problem(campaign: Campaign, arm: Arm) -> Problem:
    """Set up the first adjustment of `identify`, with the campaign's stated noise."""
    geometry = geometry_from_arm(arm)
    parameters = arm_parameters(geometry, campaign.joint_names)
    design = ArmValues(geometry, np.empty(0))
    parameters = with_datum(parameters, geometry)
    network = Posed(campaign, design, parameters, arm.probe.radius_mm).network()
    return Problem(network, network.start(design))


@dataclass(frozen=True, slots=True, eq=False)
class PeerResult:
    """Result of a peer."""

    state: State
    n_jacobians: int


class DensePeer:
    """A problem in scipy's form: one vector in, one vector or dense matrix out."""

    def __init__(self, problem: Problem) -> None:
        self._network, self._start = problem.network, problem.start
        self._whiteners = linearise(self._network, self._start).whiteners
        self._n_free = self._network.parameters.n_free
        widths = [len(station.scales) for station in self._network.stations]
        self._ends = self._n_free + np.concatenate([[0], np.cumsum(widths)])

    def solve(self, *, numerical: bool) -> PeerResult:
        """Minimise from the start.

        Args:
            numerical: Derivatives by differences, '2-point'; else analytic ones.
        """
        fit = least_squares(
            self._residuals,
            np.zeros(self._ends[-1]),
            jac="2-point" if numerical else self._jacobian,
            x_scale="jac",
        )
        return PeerResult(self._state(fit.x), int(fit.njev))

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
        residuals = []
        for station, unknowns, whiteners in zip(
            self._network.stations, state.unknowns, self._whiteners, strict=True
        ):
            rows_mm = self._network.misclosures_mm(station, state.arm, unknowns)
            residuals.append((whiteners @ rows_mm[:, :, np.newaxis]).ravel())
            certificate = station.artefact.certificate(unknowns, station.touches)
            residuals.append(certificate.misclosures_mm / certificate.std_mm)
        return np.concatenate(residuals)

    def _jacobian(self, steps: Floats) -> Floats:
        state = self._state(steps)
        blocks = []
        for number, station in enumerate(self._network.stations):
            columns = slice(self._ends[number], self._ends[number + 1])
            unknowns = state.unknowns[number]
            blocks.append(self._station_block(number, station, state, columns))
            certificate = station.artefact.certificate(unknowns, station.touches)
            rows = np.zeros((len(certificate.std_mm), self._ends[-1]))
            rows[:, columns] = (
                certificate.by_unknowns / certificate.std_mm[:, np.newaxis]
            )
            blocks.append(rows)
        return np.vstack(blocks)

    def _station_block(
        self, number: int, station: Station, state: State, places: slice
    ) -> Floats:
        poses = self._network.campaign.poses
        parameters = self._network.parameters
        angles_rad = poses.angles_rad[station.poses]
        shape = (len(angles_rad), station.artefact.rows_per_pose, self._ends[-1])
        rows = np.zeros(shape)
        for part, derivatives in derivative_chunks(state.arm.geometry, angles_rad):
            equations = station.artefact.equations(
                state.unknowns[number],
                derivatives.centres_mm,
                station.touches.part(part),
            )
            # Steps are counted from the start, so its basis is the one to take.
            columns = parameters.columns(
                self._start.arm, derivatives, poses.part(station.poses[part])
            )
            whiteners = self._whiteners[number][part]
            rows[part, :, : self._n_free] = whiteners @ (equations.by_centre @ columns)
            rows[part, :, places] = whiteners @ equations.by_unknowns
        return rows.reshape(-1, self._ends[-1])
