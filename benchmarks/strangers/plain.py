"""The usual way beside ours: all lengths and axes by scipy's least squares.

It shares no code with the identification: forward kinematics of its own in NumPy, the
parameters of a product of exponentials, redundant ones left to the solver, every pose
of equal weight, no blunders removed.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from benchmarks.strangers.sets import GAUGE_MM, Measured
from traverse.arrays import Booleans, Floats
from traverse.kinematics.arm_file.arm import Arm

GAUGE_WEIGHT = 10.0  # the distance of two sockets counts as much as 100 poses


@dataclass(frozen=True, slots=True)
class Chain:
    """Axes (n, 3) of unit length and links (n, 3) in mm, of the base posture."""

    axes: Floats
    links_mm: Floats

    def places_mm(self, angles_rad: Floats) -> Floats:
        positions_mm = np.zeros((len(angles_rad), 3))
        for joint in reversed(range(len(self.axes))):
            turn = Rotation.from_rotvec(angles_rad[:, joint, None] * self.axes[joint])
            positions_mm = turn.apply(positions_mm + self.links_mm[joint])
        return positions_mm


def chain_of(arm: Arm) -> Chain:
    """The nominal chain; readings of its base posture are zero."""
    links_mm = np.array([joint.link_mm for joint in arm.joints])
    links_mm[-1] += np.array(arm.probe.vector_mm)
    return Chain(np.array([joint.axis for joint in arm.joints]), links_mm)


def fitted(nominal: Chain, measured: Measured, *, tool_only: bool = False) -> Chain:
    """The chain that fits the poses that were not kept aside."""
    used = ~measured.is_kept
    angles_rad, judge = measured.angles_rad[used], _misclosures(measured, used)
    n = len(nominal.axes)
    across = np.array([_across(axis) for axis in nominal.axes])

    def made(x: Floats) -> Chain:
        links_mm = nominal.links_mm.copy()
        if tool_only:
            links_mm[-1] += x[:3]
            return Chain(nominal.axes, links_mm)
        axes = nominal.axes + np.einsum("jk,jkc->jc", x[: 2 * n].reshape(n, 2), across)
        links_mm += x[2 * n : 5 * n].reshape(n, 3)
        return Chain(axes / np.linalg.norm(axes, axis=1)[:, None], links_mm)

    start = np.zeros(3 if tool_only else 5 * n)
    scale = 10.0 if tool_only else np.r_[np.full(2 * n, 0.01), np.full(3 * n, 10.0)]
    fit = least_squares(
        lambda x: judge(made(x).places_mm(angles_rad)), start, x_scale=scale
    )
    return made(fit.x)


def held_out_mm(positions_mm: Floats, measured: Measured) -> Floats:
    """Return distances of the poses kept aside, from ball positions in all poses.

    The same for every fit: a socket is at the mean of the poses kept aside, the tracker
    at the best fit of the other poses, or of those kept aside if it was moved.
    Positions are (n, 3).
    """
    kept = measured.is_kept
    if measured.places_mm is None:
        off = _from_sockets(positions_mm[kept], _numbers(measured, kept))
    else:
        placing = kept if measured.was_moved else ~kept
        turn, shift = _frame(measured.places_mm[placing], positions_mm[placing])
        off = positions_mm[kept] - (turn.apply(measured.places_mm[kept]) + shift)
    distances: Floats = np.linalg.norm(off, axis=1)
    return distances


def _misclosures(measured: Measured, used: Booleans) -> Callable[[Floats], Floats]:
    """Make the function from places of the ball, (n_used, 3), to misclosures."""
    if measured.places_mm is not None:
        seen_mm = measured.places_mm[used]

        def of_tracker(positions_mm: Floats) -> Floats:
            turn, shift = _frame(seen_mm, positions_mm)
            return np.ravel(positions_mm - (turn.apply(seen_mm) + shift))

        return of_tracker
    numbers = _numbers(measured, used)
    pairs = {place for place, _ in np.array(measured.sockets)[used]}
    names = list(dict.fromkeys(tuple(s) for s in np.array(measured.sockets)[used]))
    places = [(names.index((p, "1")), names.index((p, "2"))) for p in sorted(pairs)]

    def of_sockets(positions_mm: Floats) -> Floats:
        mean = _means(positions_mm, numbers)
        gauge = [np.linalg.norm(mean[a] - mean[b]) - GAUGE_MM for a, b in places]
        return np.r_[
            np.ravel(positions_mm - mean[numbers]), GAUGE_WEIGHT * np.array(gauge)
        ]

    return of_sockets


def _numbers(measured: Measured, rows: Booleans) -> np.ndarray:
    """Number of the socket of each pose, by its first appearance."""
    sockets = [tuple(s) for s in np.array(measured.sockets)[rows]]
    names = list(dict.fromkeys(sockets))
    return np.array([names.index(socket) for socket in sockets])


def _means(positions_mm: Floats, numbers: np.ndarray) -> Floats:
    count = np.bincount(numbers)
    means: Floats = np.stack(
        [np.bincount(numbers, positions_mm[:, k]) / count for k in range(3)], axis=1
    )
    return means


def _from_sockets(positions_mm: Floats, numbers: np.ndarray) -> Floats:
    return positions_mm - _means(positions_mm, numbers)[numbers]


def _frame(seen_mm: Floats, positions_mm: Floats) -> tuple[Rotation, Floats]:
    """Rigid motion of the tracker's places onto the arm's (Kabsch 1976)."""
    middle, centre = seen_mm.mean(axis=0), positions_mm.mean(axis=0)
    turn, _ = Rotation.align_vectors(positions_mm - centre, seen_mm - middle)
    return turn, centre - turn.apply(middle)


def _across(axis: Floats) -> Floats:
    """Two unit vectors across an axis, (2, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    first = np.cross(axis, helper)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(axis, first)])
