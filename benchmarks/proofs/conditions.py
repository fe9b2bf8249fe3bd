"""Condition numbers of geometry and encoder harmonics, by how far joints turn.

100 poses in 5 seats, two of which are a known distance apart; columns scaled to unit
length. The figures scatter with the postures, so the median of several sets counts.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.proofs.campaigns import demo_arm
from kinematics.derivatives import ProbeDerivatives
from kinematics.geometry import Geometry
from lab.campaign import Poses
from lab.identification.identify import Options, identify
from simulator.campaigns import CampaignSpec, simulate_campaign
from traverse.blind_campaign import handed_over

Floats = NDArray[np.float64]

# As derived beforehand, by another program, for an arm and places that are not known:
# the pattern is to be compared, not the figures.
EXPECTED = {
    "full": (17.0, 22.0, 31.0),
    "wide": (28.0, 72.0, 683.0),
    "narrow": (74.0, 328.0, 13472.0),
}
ORDERS: tuple[tuple[int, ...], ...] = ((), (1,), (1, 2))
_HOPELESS_RAD = 1e3
_N_POSES = 100


@dataclass(frozen=True, slots=True)
class Harmonics:
    """Encoder errors cos and sin of order times the reading, of every joint."""

    order: int
    joint_names: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Two a joint."""
        return tuple(
            f"{joint}.harmonic_{self.order}.{part}"
            for joint in self.joint_names
            for part in ("cos", "sin")
        )

    @property
    def units(self) -> tuple[str, ...]:
        """Radians."""
        return ("rad",) * (2 * len(self.joint_names))

    @property
    def tolerances(self) -> tuple[float, ...]:
        """So wide that nothing is held: the numbers of the whole are wanted."""
        return (_HOPELESS_RAD,) * (2 * len(self.joint_names))

    def columns(
        self, geometry: Geometry, derivatives: ProbeDerivatives, poses: Poses
    ) -> Floats:
        """Compute the derivatives of x, (n_poses, 3, 2 n_joints)."""
        phases_rad = self.order * poses.angles_rad[:, np.newaxis]
        parts = (np.cos(phases_rad), np.sin(phases_rad))
        pairs = np.stack([derivatives.by_angles * part for part in parts], axis=3)
        return pairs.reshape(*pairs.shape[:2], -1)


def median_conditions(travel: str, n_sets: int) -> list[float]:
    """Compute the condition numbers for each of `ORDERS`."""
    return [
        float(np.median([_condition(travel, orders, seed) for seed in range(n_sets)]))
        for orders in ORDERS
    ]


def _condition(travel: str, orders: tuple[int, ...], seed: int) -> float:
    artefacts: list[dict[str, object]] = [
        {"id": f"seat-{number}", "kind": "cone", "n_poses": _N_POSES // 5}
        for number in range(3)
    ]
    # Two seats a known distance apart: one certified length.
    pair = {"id": "pair", "kind": "points", "frame": "own", "n_points": 2}
    artefacts.append({**pair, "size_mm": 800.0, "n_poses": 2 * _N_POSES // 5})
    spec = CampaignSpec.model_validate(
        {"artefacts": tuple(artefacts), "travel": travel, "conditions": {"columns": ()}}
    )
    arm = demo_arm()
    simulated = simulate_campaign(arm, spec, seed)
    names = tuple(joint.name for joint in arm.joints)
    options = Options(
        terms=tuple(Harmonics(order, names) for order in orders),
        snooping=False,
        coarse_start=False,
        n_suggestions=0,
    )
    result = identify(handed_over(simulated.campaign), arm, options)
    return result.condition_number
