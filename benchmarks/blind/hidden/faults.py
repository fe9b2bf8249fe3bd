"""Faults to hide that no entry of an arm file names; the right answer is: unknown."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.blind.hidden.effects import HiddenEffect
from traverse.simulator.campaigns.pose_set import PoseSet
from traverse.simulator.effects import (
    Bump,
    CrossCoupling,
    CubicError,
    Fault,
    JumpInAngle,
    Sawtooth,
    SquareOfTemperature,
)

_N_KNOTS = 7
CURVE = "empirical"


@dataclass(frozen=True, slots=True)
class HiddenFault:
    """One encoder fault, without a name.

    Attributes:
        kind: name in a score table.
        covariate: named like a column of a campaign.
        fault: as the simulator plays it.
        size_key: attribute of the fault that grows with it.
    """

    kind: str
    joint: str
    covariate: str
    fault: Fault
    size_key: str

    def scaled(self, factor: float) -> "HiddenFault":
        fault: Any = self.fault  # all of them are dataclasses
        size = factor * getattr(fault, self.size_key)
        return replace(self, fault=replace(fault, **{self.size_key: size}))

    @property
    def keys(self) -> dict[str, Any]:
        return {self.size_key: getattr(self.fault, self.size_key)}


@dataclass(frozen=True, slots=True)
class _Spot:
    """Place of a fault.

    Attributes:
        angles_rad: of the joint's encoder in the poses, (n_poses,).
    """

    rng: np.random.Generator
    poses: PoseSet
    joint: int
    joints: slice
    angles_rad: np.ndarray[Any, np.dtype[np.float64]]

    def angle(self, low: float, high: float) -> float:
        """Draw an angle between two quantiles of those in the poses."""
        return float(np.quantile(self.angles_rad, self.rng.uniform(low, high)))


def _bump(spot: _Spot) -> tuple[Fault, str]:
    half_width_rad = float(spot.rng.uniform(0.25, 0.6))
    return Bump(spot.joints, spot.angle(0.2, 0.8), half_width_rad, 2e-5), "height_rad"


def _jump(spot: _Spot) -> tuple[Fault, str]:
    return JumpInAngle(spot.joints, spot.angle(0.2, 0.8), 2e-5), "step_rad"


def _cubic(spot: _Spot) -> tuple[Fault, str]:
    return CubicError(spot.joints, 1e-5), "rate_per_rad2"


def _sawtooth(spot: _Spot) -> tuple[Fault, str]:
    teeth = int(spot.rng.integers(2, 9))
    return Sawtooth(spot.joints, teeth, 2e-5), "height_rad"


def _coupling(spot: _Spot) -> tuple[Fault, str]:
    n_joints = spot.poses.truth.mechanism.n_joints
    other_joints = [number for number in range(n_joints) if number != spot.joint]
    fault = CrossCoupling(
        spot.joints,
        other=int(spot.rng.choice(other_joints)),
        height_rad=2e-5,
        order=int(spot.rng.integers(1, 4)),
        phase_rad=float(spot.rng.uniform(-np.pi, np.pi)),
    )
    return fault, "height_rad"


def _square(spot: _Spot) -> tuple[Fault, str]:
    return SquareOfTemperature(spot.joints, 5e-6), "rate_rad_c2"


_MAKERS: dict[str, Callable[[_Spot], tuple[Fault, str]]] = {
    "bump": _bump,
    "step in the angle": _jump,
    "cubic": _cubic,
    "sawtooth": _sawtooth,
    "cross-coupling": _coupling,
    "square of temperature": _square,
}
FAULT_KINDS = (*_MAKERS, CURVE)


def drawn_fault(
    rng: np.random.Generator, poses: PoseSet, kind: str
) -> HiddenFault | HiddenEffect:
    """Draw a fault of a kind in a plausible size.

    Args:
        rng: Draws the joint and where on its disc.
        poses: Where it will be played.
        kind: One of `FAULT_KINDS`.
    """
    joint = int(rng.integers(len(poses.arm.joints)))
    angles_rad = poses.turns_rad[:, joint] + poses.truth.zeros_rad[joint]
    spot = _Spot(rng, poses, joint, slice(joint, joint + 1), angles_rad)
    names = [modelled.name for modelled in poses.arm.joints]
    if kind == CURVE:
        return _curve(spot, names[joint])
    fault, size_key = _MAKERS[kind](spot)
    covariate = f"{names[joint]}_rad"
    if isinstance(fault, CrossCoupling):
        covariate = f"{names[fault.other]}_rad"
    elif isinstance(fault, SquareOfTemperature):
        covariate = "temperature_c"
    return HiddenFault(kind, names[joint], covariate, fault, size_key)


def _curve(spot: _Spot, joint: str) -> HiddenEffect:
    """Draw a random curve over the joint's own reading."""
    low, high = float(np.min(spot.angles_rad)), float(np.max(spot.angles_rad))
    knots = tuple(np.linspace(low, high, _N_KNOTS).tolist())
    values = tuple((1e-5 * spot.rng.standard_normal(_N_KNOTS)).tolist())
    fixed = {"covariate": f"{joint}_rad", "knots": knots}
    return HiddenEffect(CURVE, joint, fixed, {"values_rad": values})
