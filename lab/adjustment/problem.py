"""The adjustment problem: every artefact with the poses that touched it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise

import numpy as np

from traverse.arrays import Booleans, Floats, Integers
from traverse.kinematics.helmert.transformation import N_RIGID, motions
from traverse.kinematics.model.derivatives import probe_derivatives
from traverse.kinematics.model.quaternion import conjugate, multiply
from traverse.lab.adjustment.datum import scale_direction
from traverse.lab.adjustment.equations import (
    Equations,
    Station,
    sorted_stations,
    whiteners,
)
from traverse.lab.adjustment.noise import Noise
from traverse.lab.adjustment.parameters import ArmValues
from traverse.lab.artefacts.artefact import Touches
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.poses import evenly


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """Everything that is estimated.

    Attributes:
        unknowns: Of each station.
        corrections: Of the readings [rad], of the contact [mm] and, where there are
            orientations, of these [rad] of each station's poses, where the equations
            are linearised, (n_poses, n_joints + 3 or 6).
    """

    arm: ArmValues
    unknowns: tuple[Floats, ...]
    corrections: tuple[Floats, ...]


_START_POSES = 2000
# Random postures in which parameters are compared at the probe.
_N_POSTURES = 300
_LEAST_RANGE_RAD = np.radians(120.0)
_SEED = 20_170_101


@dataclass(frozen=True, slots=True, eq=False)
class Network(Equations):
    """The equations of the stations that take part.

    Attributes:
        holds_scale: Whether the design's scale is held, whatever lengths are known.
    """

    stations: tuple[Station, ...]
    holds_scale: bool = False

    @property
    def n_rows(self) -> int:
        return sum(station.n_rows for station in self.stations)

    def on(self, campaign: Campaign) -> "Network":
        """Take the same poses of a campaign with other columns."""
        effects = self.parameters.effects
        if effects is not None:
            effects = replace(effects, campaign=campaign)
        parameters = replace(self.parameters, effects=effects)
        return replace(self, campaign=campaign, parameters=parameters)

    @property
    def unknown_columns(self) -> tuple[slice, ...]:
        """Columns of each station's unknowns, behind those of the free parameters."""
        widths = [len(station.scales) for station in self.stations]
        ends = [*accumulate(widths, initial=self.parameters.n_free)]
        return tuple(slice(*ends) for ends in pairwise(ends))

    @property
    def poses(self) -> Integers:
        """The campaign's poses that take part, station by station."""
        none = np.empty(0, dtype=np.int64)
        return np.concatenate([none, *(station.poses for station in self.stations)])

    @property
    def included(self) -> Booleans:
        """Which of the campaign's poses take part, (n_poses,)."""
        return np.isin(np.arange(len(self.campaign.poses)), self.poses)

    def start(self, arm: ArmValues) -> State:
        """Find every station's unknowns, and mountings, in closed form from an arm.

        A few thousand poses, spread evenly, are enough for that.
        """
        unknowns: list[Floats] = []
        for station in self.stations:
            few = station.part(evenly(np.arange(len(station.poses)), _START_POSES))
            centres_mm = self.centres_mm(few, arm)
            unknowns.append(station.artefact.start(centres_mm, few.touches))
        n_joints = self.parameters.n_joints
        nothing = tuple(
            np.zeros((len(station.poses), n_joints + max(station.most_rows, 3)))
            for station in self.stations
        )
        if self.parameters.mounted:
            arm = replace(arm, mountings=self.fitted_mountings(arm, unknowns))
        return State(arm, tuple(unknowns), nothing)

    def fitted_mountings(self, arm: ArmValues, unknowns: Sequence[Floats]) -> Floats:
        """Find how the instrument's probes are mounted, as unit quaternions.

        Each pose says P_n^-1 R O; blunders are weighted down in their mean. A mounting
        that no pose of the stations speaks of stays. (n_mounted, 4)
        """
        mountings = arm.mountings.copy()
        parts: dict[int, list[Floats]] = {}
        for station, of_station in zip(self.stations, unknowns, strict=True):
            for chunk in self._chunks(station, arm, None):
                if chunk.turns is not None:
                    touches = station.touches.part(chunk.part)
                    seen = station.artefact.measured_orientations(of_station, touches)
                    mountings_seen = multiply(conjugate(chunk.body_turns), seen)
                    parts.setdefault(chunk.tool, []).append(mountings_seen.T)
        for index, tool in enumerate(self.parameters.mounted):
            if tool in parts:
                mountings[index] = _mean_rotation(np.concatenate(parts[tool]))
        return mountings

    def stations_of(
        self, included: Booleans, campaign: Campaign | None = None
    ) -> tuple[Station, ...]:
        """Sort the included poses by artefact, (n_poses,), also of another campaign."""
        return sorted_stations(campaign or self.campaign, self.radius_mm, included)

    def of_poses(self, included: Booleans, noise: Noise | None = None) -> "Network":
        """Let the included poses take part, (n_poses,)."""
        stations = self.stations_of(included)
        return replace(self, stations=stations, noise=noise or self.noise)

    def known_stations(
        self, state: State, included: Booleans, campaign: Campaign | None = None
    ) -> tuple[tuple[Station, ...], tuple[Floats, ...]]:
        """Sort the included poses, and find the state of their artefacts.

        Artefacts that take no part in the network are left out.
        """
        unknowns = {
            station.index: of_station
            for station, of_station in zip(self.stations, state.unknowns, strict=True)
        }
        known = tuple(
            station
            for station in self.stations_of(included, campaign)
            if station.index in unknowns
        )
        return known, tuple(unknowns[station.index] for station in known)

    def orientation_errors_of(
        self, state: State, campaign: Campaign | None = None
    ) -> Floats:
        """Compare all orientations with a state, (n_poses, 3) [rad].

        Also those of another campaign; of artefacts without a place there are none.
        """
        campaign = campaign or self.campaign
        errors_rad = np.full((len(campaign.poses), 3), np.nan)
        every = np.ones(len(errors_rad), dtype=np.bool_)
        known, unknowns = self.known_stations(state, every, campaign)
        network = self.on(campaign)
        for station, of_station in zip(known, unknowns, strict=True):
            errors_rad[station.poses] = network.orientation_errors_rad(
                station, state.arm, of_station
            )
        return errors_rad

    def certified(self, station: Station, arm: ArmValues, unknowns: Floats) -> Floats:
        """Whiten a station's certificate: unknowns, parameters, right side.

        A standard whose certificate is off by some ppm is as long as it says and that
        much more.
        """
        certificate = station.artefact.certificate(unknowns, station.touches)
        if not len(certificate.misclosures_mm):
            n_unknowns = certificate.by_unknowns.shape[1]
            return np.empty((0, n_unknowns + self.parameters.n_free + 1))
        misclosures_mm = certificate.misclosures_mm.copy()
        by_parameters = np.zeros((len(misclosures_mm), self.parameters.n_free))
        for length in station.artefact.lengths(unknowns):
            row = length.certificate_row
            if row is not None:
                certified_mm = length.value_mm - float(certificate.misclosures_mm[row])
                errors = self.parameters.length_errors(arm, station.artefact.id)
                misclosures_mm[row] -= 1e-6 * errors[0] * certified_mm
                by_parameters[row] -= 1e-6 * errors[1] * certified_mm
        rows = np.hstack(
            [certificate.by_unknowns, by_parameters, -misclosures_mm[:, np.newaxis]]
        )
        # One that was left out has an infinite standard deviation.
        known = np.isfinite(certificate.std_mm)
        return rows[known] / certificate.std_mm[known, np.newaxis]

    def has_length(self) -> bool:
        """Return whether anything determines the scale."""
        expected = self.parameters.expected
        if expected is not None and any(".link." in name for name in expected.names):
            return True
        return any(
            station.artefact.fixes_scale(station.touches) for station in self.stations
        )

    def undetermined_scale(self, arm: ArmValues) -> Floats:
        """Return the direction of a scale that is held, or that no length determines.

        (1, n_free), or (0, n_free) where the scale is determined.
        """
        if self.has_length() and not self.holds_scale:
            return np.empty((0, self.parameters.n_free))
        return scale_direction(self.parameters, arm.geometry, arm.tools_mm)

    def probe_effects_mm(self, arm: ArmValues, steps: Floats) -> Floats:
        """Compute the root mean square shift of the probe by each step, (n_steps,).

        Over random postures within the travelled ranges, but at least 120 degrees a
        joint: an arm is identified to be used. The motion of the arm as a whole is
        taken out: it depends on the datum only. Steps are those of the free parameters,
        (n_steps, n_free).
        """
        columns, centres_mm = self.posture_columns(arm)
        shifts_mm = np.einsum("nip,sp->nis", columns, steps).reshape(-1, len(steps))
        local_mm = centres_mm - centres_mm.mean(axis=0)
        basis = np.linalg.qr(motions(local_mm, N_RIGID).reshape(-1, N_RIGID))[0]
        rest_mm = shifts_mm - basis @ (basis.T @ shifts_mm)
        effects: Floats = np.sqrt(np.sum(rest_mm**2, axis=0) / len(centres_mm))
        return effects

    def posture_columns(self, arm: ArmValues) -> tuple[Floats, Floats]:
        """Compute derivatives (n, 3, n_free) and centres (n, 3) at random postures.

        With the arm's own tool; what effects need beside angles is that of other poses.
        """
        angles_rad = self.campaign.poses.angles_rad[self.poses]
        rng = np.random.default_rng(_SEED)
        least, largest = angles_rad.min(axis=0), angles_rad.max(axis=0)
        wider_rad = np.maximum(0.5 * (_LEAST_RANGE_RAD - (largest - least)), 0.0)
        postures_rad = rng.uniform(
            least - wider_rad, largest + wider_rad, (_N_POSTURES, angles_rad.shape[1])
        )
        derivatives = probe_derivatives(arm.geometry, postures_rad)
        like = self.campaign.poses.part(rng.choice(self.poses, _N_POSTURES))
        like = replace(like, angles_rad=postures_rad, tools=None)
        return self.parameters.columns(arm, derivatives, like), derivatives.centres_mm

    def geometric_columns(
        self, arm: ArmValues, postures_rad: Floats
    ) -> tuple[Floats, Floats]:
        """Compute derivatives (n, 3, n_free) and centres (n, 3) at some postures.

        Effects are left out: their columns need more than a posture.
        """
        derivatives = probe_derivatives(arm.geometry, postures_rad)
        parameters = self.parameters
        geometric = parameters.of_geometry()
        columns = np.zeros((len(postures_rad), 3, parameters.n_free))
        columns[:, :, : geometric.n_free] = geometric.columns(
            arm, derivatives, self.campaign.poses.part(slice(0))
        )
        return columns, derivatives.centres_mm

    def rows_at(
        self,
        at: int,
        state: State,
        angles_rad: Floats,
        touches: Touches,
    ) -> Floats:
        """Whiten what touches of a station in other postures would say.

        Of readings (n, n_joints) with the arm's own tool; of parameters and the
        station's unknowns, (n, n_rows, n_free + n_unknowns).
        """
        station, unknowns = self.stations[at], state.unknowns[at]
        derivatives = probe_derivatives(state.arm.geometry, angles_rad)
        equations = station.artefact.equations(
            unknowns, derivatives.centres_mm, touches
        )
        by_centre = equations.by_centre
        by_readings = by_centre @ (derivatives.by_angles * self.noise.encoder_rad)
        by_contact = by_centre * float(self.noise.contact_mm[station.index])
        like = self.campaign.poses.part(np.resize(station.poses, len(angles_rad)))
        like = replace(like, angles_rad=angles_rad, tools=None)
        columns = self.parameters.columns(state.arm, derivatives, like)
        joined = np.concatenate([by_centre @ columns, equations.by_unknowns], axis=2)
        rows: Floats = whiteners(by_readings, by_contact) @ joined
        return rows

    def rms_mm(self, state: State) -> float:
        """Compute the root mean square of all scalar misclosures of a state."""
        total, n_rows = 0.0, 0
        for station, unknowns in zip(self.stations, state.unknowns, strict=True):
            of_station_mm = self.misclosures_mm(station, state.arm, unknowns)
            total += float(np.sum(of_station_mm**2))
            n_rows += of_station_mm.size
        return float(np.sqrt(total / max(n_rows, 1)))


_MOUNTING_ROUNDS = 10


def _mean_rotation(quaternions: Floats) -> Floats:
    """Average unit quaternions (n, 4), whatever their signs, robustly."""
    weights = np.ones(len(quaternions))
    for _ in range(_MOUNTING_ROUNDS):
        squares = (weights[:, np.newaxis] * quaternions).T @ quaternions
        mean: Floats = np.linalg.eigh(squares)[1][:, -1]
        away_rad = 2.0 * np.arccos(np.minimum(np.abs(quaternions @ mean), 1.0))
        least_rad = max(3.0 * float(np.median(away_rad)), 1e-9)
        weights = 1.0 / (1.0 + (away_rad / least_rad) ** 2)
    return mean
