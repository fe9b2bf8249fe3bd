"""Undetermined or weak directions, in words: combinations of named parameters.

The reason is looked for in the campaign: no length, a joint that hardly turned, a
probe on the last axis; else the poses as a whole are to blame.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.adjustment import Adjustment, Network
from traverse.lab.identification.optimal_design import (
    JointCoverage,
    joint_coverage,
)
from traverse.lab.outcomes.identified import Weak

# Uncertainty beyond this part of its tolerance: the direction is called weak, and so is
# one that moves the probe by more than ten contacts' noise.
_WEAK = 0.2


_WEAK_IN_CONTACTS = 10.0


_ON_THE_AXIS_MM = 2.0


_NO_LENGTH = (
    "no length in this campaign: the scale of the whole arm is not determined; add a "
    "ball bar or another known length"
)


@dataclass(frozen=True, slots=True)
class Undetermined:
    """A combination of parameters that the data do not determine.

    Attributes:
        direction: Components by name, in units of the plausible deviations, of unit
            length together; small ones left out.
        probe_mm: How far the probe moves by it (root mean square) where the design is
            off by a plausible deviation; the motion of the arm as a whole is taken out.
        why: The reason and the remedy.
        is_scale: Whether it is how large the whole arm is.
    """

    direction: dict[str, float]
    probe_mm: float
    why: str
    is_scale: bool = False


def undetermined_directions(adjustment: Adjustment) -> tuple[Undetermined, ...]:
    """Name every direction that is held at its design value."""
    network, split = adjustment.network, adjustment.split
    arm = adjustment.state.arm
    if not len(split.undetermined):
        return ()
    scale = network.undetermined_scale(arm)
    # The adjustment holds the scale by decree, as the last direction.
    sparse = _sparse(split.undetermined[: len(split.undetermined) - len(scale)])
    directions = np.concatenate([scale, sparse])
    effects_mm = network.probe_effects_mm(arm, directions * split.tolerances)
    coverage = joint_coverage(network.campaign, network.poses)
    return tuple(
        Undetermined(
            network.parameters.named(direction),
            effect_mm,
            _NO_LENGTH
            if index < len(scale)
            else _reason(network, arm.geometry, coverage, direction),
            is_scale=index < len(scale),
        )
        for index, (direction, effect_mm) in enumerate(
            zip(directions, effects_mm.tolist(), strict=True)
        )
    )


def weak_directions(adjustment: Adjustment, factor: float) -> tuple[Weak, ...]:
    """Name the determined directions with large uncertainty, the worst first."""
    network, parts = adjustment.network, adjustment.split
    geometry = adjustment.state.arm.geometry
    sigma0 = float(np.sqrt(factor))
    coverage = joint_coverage(network.campaign, network.poses)
    stds = sigma0 / parts.values[: parts.n_determined]
    directions = parts.directions[: parts.n_determined]
    if len(stds) == 0:
        return ()
    steps = directions * parts.tolerances * stds[:, np.newaxis]
    effects_mm = network.probe_effects_mm(adjustment.state.arm, steps)
    limit_mm = _WEAK_IN_CONTACTS * sigma0 * float(network.noise.contact_mm.max())
    weak = np.flatnonzero((stds > _WEAK) | (effects_mm > limit_mm))
    weak = weak[np.argsort(-effects_mm[weak])]
    return tuple(
        Weak(
            network.parameters.named(direction),
            float(std),
            float(effect_mm),
            _reason(network, geometry, coverage, direction),
        )
        for direction, std, effect_mm in zip(
            directions[weak], stds[weak], effects_mm[weak], strict=True
        )
    )


def _sparse(rows: Floats) -> Floats:
    """Combine orthonormal rows so that each names few parameters.

    Every row gets a parameter of its own, chosen by pivoting, in which the others
    have nothing.
    """
    if len(rows) == 0:
        return rows
    left, pivots = rows.copy(), []
    for _ in range(len(rows)):
        sizes = np.linalg.norm(left, axis=0)
        pivots.append(int(np.argmax(sizes)))
        unit = left[:, pivots[-1]] / sizes[pivots[-1]]
        left = left - np.outer(unit, unit @ left)
    pivoted = np.linalg.solve(rows[:, pivots], rows)
    sparse: Floats = pivoted / np.linalg.norm(pivoted, axis=1, keepdims=True)
    return sparse


# Parameters that are written of a combination.
_MOST_NAMES = 6


def combination(direction: Mapping[str, float]) -> str:
    """Write a combination of parameters, the largest first, not all of a long one."""
    largest = sorted(direction.items(), key=lambda entry: -abs(entry[1]))
    shown = ", ".join(f"{name} {value:+.2f}" for name, value in largest[:_MOST_NAMES])
    more = len(largest) - _MOST_NAMES
    return f"{shown} and {more} more" if more > 0 else shown


def _reason(
    network: Network,
    geometry: Geometry,
    coverage: Sequence[JointCoverage],
    direction: Floats,
) -> str:
    components = network.parameters.named(direction)
    joints = {name.split(".")[0] for name in components}
    still = [
        joint for joint in coverage if joint.joint in joints and joint.hardly_turned
    ]
    if still:
        joint = min(still, key=lambda entry: entry.travel_rad)
        return (
            f"{joint.joint} turned by {np.degrees(joint.travel_rad):.2g} degrees only: "
            "turn it"
        )
    names = network.campaign.joint_names
    last = names[-1]
    reach_mm, axis = geometry.links_mm[-1] + geometry.probe_vector_mm, geometry.axes[-1]
    offset_mm = float(np.linalg.norm(reach_mm - (reach_mm @ axis) * axis))
    if last in joints and offset_mm < _ON_THE_AXIS_MM:
        return (
            f"the probe lies on the axis of {last} ({offset_mm:.2g} mm from it): "
            f"turning {last} does not move it; use a probe beside the axis"
        )
    if any(name.startswith("probe.vector") for name in components):
        return "the probe vector does the same as the last links: hold one of them"
    least = min(coverage, key=lambda entry: entry.travel_rad)
    return (
        f"the {len(network.poses)} poses do not tell these apart (least travel: "
        f"{least.joint}, {np.degrees(least.travel_rad):.0f} degrees); measure more "
        "and more varied postures"
    )
