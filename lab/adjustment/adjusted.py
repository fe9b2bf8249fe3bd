"""The result of one adjustment, and what follows from it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.arm_file.arm import Arm, Probe
from traverse.kinematics.uncertainty.arm_covariance import parameter_names
from traverse.lab.adjustment.datum import stretch
from traverse.lab.adjustment.equations import Station
from traverse.lab.adjustment.noise import Noise
from traverse.lab.adjustment.parameters import ArmValues
from traverse.lab.adjustment.pose_statistics import (
    PoseStatistics,
    pose_statistics,
    predicted,
)
from traverse.lab.adjustment.problem import Network, State
from traverse.lab.adjustment.system import RankDecision, System, decide_rank, linearise
from traverse.lab.outcomes.adjustment import CartesianCovariance, Iteration
from traverse.lab.statistics.distributions import normal_quantile

# Determined directions that tell how far an arm is from its design.
_LEAST_KNOWN = 6
# Of the absolute values of a normal distribution with deviation 1.
_MEDIAN_OF_NORMAL = 0.6745
# Part of what is assumed up to which a combination counts as determined.
_DETERMINED = 0.5
# Probability that an arm of the family contradicts it in any parameter.
_FAMILY_LEVEL = 0.01
# Part of an expectation's variance in its residual, below which poses do not test it:
# what is left of the last step would pass for a contradiction.
_UNTESTABLE = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Adjustment:
    """The result of one adjustment.

    Attributes:
        split: Of the arm's parameters there.
        converged: Whether the last step was negligible, and misclosures did not keep
            every parameter from being determined.
        redundancy: Equations and certificates less determined unknowns.
        last_step: Of the free parameters, undamped, (n_free,).
    """

    network: Network
    state: State
    system: System
    split: RankDecision
    iterations: tuple[Iteration, ...]
    converged: bool
    redundancy: int
    last_step: Floats

    def changes(self, design: ArmValues) -> Floats:
        """Of the free parameters, in plausible deviations, (n_free,)."""
        parameters = self.network.parameters
        changes = parameters.coordinates(self.state.arm, design)[parameters.free]
        return changes / parameters.free_tolerances

    @property
    def sigma0(self) -> float:
        """A-posteriori standard deviation of unit weight."""
        if self.redundancy <= 0:
            return 1.0
        return float(np.sqrt(self.system.sum_of_squares / self.redundancy))

    def with_noise(self, noise: Noise) -> "Adjustment":
        """Weigh the observations with another noise; the estimates stay as they are."""
        network = replace(self.network, noise=noise)
        system = linearise(network, self.state)
        split = decide_rank(
            system.upper,
            network.parameters.free_tolerances,
            network.undetermined_scale(self.state.arm),
            self.split.n_determined,
        )
        return replace(self, network=network, system=system, split=split)

    def pose_statistics(
        self, outsiders: Sequence[Station] | None = None
    ) -> PoseStatistics:
        """Test all poses that took part, or of outsiders that took none."""
        return pose_statistics(
            self.network, self.state, self.system, self.split.inverse, outsiders
        )

    def predicted(self, poses: Booleans) -> PoseStatistics:
        """Test poses that took no part, (n_poses,), of any artefact."""
        return predicted(
            self.network, self.state, self.system, self.split.inverse, poses
        )

    def unknowns_of(self, station: Station) -> Floats:
        """Return the state of an artefact; one that took no part is where it seems."""
        for known, unknowns in zip(
            self.network.stations, self.state.unknowns, strict=True
        ):
            if known.index == station.index:
                return unknowns
        centres_mm = self.network.centres_mm(station, self.state.arm)
        return station.artefact.start(centres_mm, station.touches)

    def deviations_of_design(
        self, design: ArmValues, other_scale: float = 0.0
    ) -> Floats:
        """Return G with G G^T the covariance that undetermined directions have.

        Of the free parameters, (n_free, n_undetermined), or one column more: the arm
        may be larger or smaller by the part `other_scale` of itself.

        Strategy: undetermined directions are held at the design's values, so that their
        errors are the design's. They count with its plausible deviation, or with more
        where the determined directions show that this arm is farther from its design:
        with variance zero, lengths would be stated as if the design were exact.
        """
        split, parameters = self.split, self.network.parameters
        to_design = parameters.coordinates(design, self.state.arm)[parameters.free]
        held = design_spread(split, to_design) * split.design_deviations
        if other_scale == 0.0:
            return held
        arm = self.state.arm
        stretched = other_scale * stretch(parameters, arm.geometry, arm.tools_mm)
        return np.hstack([held, stretched.T])

    def arm_as_estimated(self, arm: Arm) -> Arm:
        """Put the estimated geometry into an arm; provenance is added on writing."""
        geometry = self.state.arm.geometry
        joints = tuple(
            joint.model_copy(
                update={
                    "axis": _vector(geometry.axes[k]),
                    "link_mm": _vector(geometry.links_mm[k]),
                    "zero_rad": float(geometry.zeros_rad[k]),
                }
            )
            for k, joint in enumerate(arm.joints)
        )
        effects = self.network.parameters.effects
        values = self.state.arm.amplitudes
        update: dict[str, object] = {
            "effects": arm.effects
            if effects is None
            else tuple(
                effect.model_copy(update=correction.keys)
                for effect, correction in zip(
                    arm.effects, effects.at(values).corrections, strict=True
                )
            ),
            "origin_mm": _vector(geometry.origin_mm),
            "joints": joints,
            "identification": None,
        }
        if tuple(arm.probe.vector_mm) != _vector(geometry.probe_vector_mm):
            probe: Probe = arm.probe.model_copy(
                update={"vector_mm": _vector(geometry.probe_vector_mm)}
            )
            update["probe"] = probe
        return arm.model_copy(update=update)

    def covariance(self, factor: float, of_design: Floats) -> Floats:
        """Compute the covariance of the free parameters, (n_free, n_free).

        Cofactors times a factor, and what undetermined directions have.
        """
        inverse = self.split.inverse
        covariance: Floats = factor * inverse @ inverse.T + of_design @ of_design.T
        return covariance

    def cartesian_covariance(self, covariance: Floats) -> CartesianCovariance:
        parameters = self.network.parameters
        values = self.state.arm
        geometry, n = values.geometry, parameters.n_joints
        basis = parameters.basis(geometry)
        first, last = 6 * n + 3, 6 * n + 3 + len(values.amplitudes)
        to_xyz = np.zeros((last + 3, len(parameters.names)))
        for k in range(n):
            to_xyz[3 * k : 3 * k + 3, 4 * k : 4 * k + 2] = basis[k].T
            link = 3 * (n + k)
            to_xyz[link : link + 3, 4 * k + 2 : 4 * k + 4] = basis[k].T
        to_xyz[6 * n : 6 * n + 3, 4 * n + 3 : 4 * n + 6] = np.eye(3)
        names_of_effects: tuple[str, ...] = ()
        if parameters.effects is not None:
            to_xyz[first:last, parameters.n_geometric :] = (
                parameters.effects.directions(geometry)
            )
            names_of_effects = parameters.effects.effects.parameter_names
        to_xyz[last:, 4 * n : 4 * n + 3] = np.eye(3)
        free = to_xyz[:, parameters.free]
        names = parameter_names(self.network.campaign.joint_names, names_of_effects)
        all_values = np.concatenate(
            [
                geometry.axes.ravel(),
                geometry.links_mm.ravel(),
                geometry.probe_vector_mm,
                values.amplitudes,
                geometry.origin_mm,
            ]
        )
        return CartesianCovariance(names, all_values, free @ covariance @ free.T)

    def mass_distribution(self) -> dict[str, Any]:
        """Say what was estimated of masses, as reports and JSON files have it.

        Combinations are those of the covariance over the assumed variances, their `std`
        a part of the assumed one; empty where no first moment was estimated for want of
        masses.
        """
        parameters = self.network.parameters
        model = parameters.effects
        if model is None or model.assumed is None:
            return {}
        is_moment = np.zeros(len(parameters.names), dtype=np.bool_)
        is_moment[parameters.n_geometric :][model.moments] = True
        is_free = parameters.free[is_moment]
        if not np.any(is_free):
            return {}
        joints = model.effects.joint_names
        moments = model.at(self.state.arm.amplitudes).first_moments
        stds_kg_m = model.assumed.stds_of(moments)[is_free]
        are_moments = is_moment[parameters.free]
        white = self.split.inverse[are_moments] / stds_kg_m[:, np.newaxis]
        squares, directions = np.linalg.eigh(white @ white.T)
        combinations = np.zeros((len(squares), parameters.n_free))
        combinations[:, are_moments] = directions.T
        return {
            "assumed_mass_kg": model.assumed.mass_kg,
            "first_moments_kg_m": {joints[m.joints.start]: m.values for m in moments},
            "determined": [
                {
                    "direction": parameters.named(combination),
                    "std": float(np.sqrt(square)),
                }
                for square, combination in zip(squares, combinations, strict=True)
                if square < _DETERMINED**2
            ],
            "combinations": len(squares),
        }

    def contradicted_expectation(self) -> tuple[str, float] | None:
        """Name the parameter that contradicts the arm's family most, if one does.

        And by how many standard deviations, as in Baarda's test of single observations.
        """
        parameters = self.network.parameters
        expected = parameters.family_expectations(self.state.arm)
        if len(expected) == 0:
            return None
        inverse = expected[:, :-1] @ self.split.inverse
        left = 1.0 - np.sum(inverse**2, axis=1)
        sizes = np.abs(expected[:, -1]) / np.sqrt(np.maximum(left, _UNTESTABLE))
        w = np.where(left > _UNTESTABLE, sizes, 0.0)
        worst = int(np.argmax(w))
        if w[worst] < -normal_quantile(0.5 * _FAMILY_LEVEL / len(w)):
            return None
        return parameters.free_names[int(np.argmax(expected[worst, :-1]))], float(
            w[worst]
        )


def design_spread(parts: RankDecision, to_design: Floats) -> float:
    """Estimate how far an arm is from its design, at least 1: in plausible deviations.

    A robust standard deviation over the directions that are determined.
    """
    known = parts.directions[: parts.n_determined] @ (to_design / parts.tolerances)
    if len(known) < _LEAST_KNOWN:
        return 1.0
    return max(float(np.median(np.abs(known))) / _MEDIAN_OF_NORMAL, 1.0)


def _vector(values: Sequence[float] | Floats) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
