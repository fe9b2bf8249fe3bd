"""The geometry of an arm in its base posture, as arrays ready for computing."""

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from traverse.arrays import Floats

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Arm


class Coupling(NamedTuple):
    """A hinge that another joint's drive turns, too; joints counted from 0."""

    joint: int
    other: int
    ratio: float


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """An arm in its base posture; every array is read-only float64.

    The turn of hinge k is alpha_k - alpha0_k, and where it is coupled to joint j that
    plus ratio (alpha_j - alpha0_j).

    Attributes:
        origin_mm: x_0, (3,).
        axes: u_k, unit vectors, (n_joints, 3).
        links_mm: r_k, (n_joints, 3).
        zeros_rad: alpha0_k, readings in the base posture, (n_joints,).
        probe_vector_mm: From the end of the last link to the ball's centre, (3,).
        probe_direction: The shank, unit vector towards the ball, (3,).
        couplings: Of hinges, one each at most.
    """

    origin_mm: Floats
    axes: Floats
    links_mm: Floats
    zeros_rad: Floats
    probe_vector_mm: Floats
    probe_direction: Floats
    couplings: tuple[Coupling, ...] = ()

    def __post_init__(self) -> None:
        axes = np.array(self.axes, dtype=np.float64)
        if axes.ndim != 2 or axes.shape[1] != 3 or len(axes) == 0:
            raise ValueError(
                f"geometry: axes have shape {axes.shape}, expected (n_joints, 3) with "
                "at least one joint"
            )
        shapes: dict[str, tuple[int, ...]] = {
            "axes": axes.shape,
            "links_mm": axes.shape,
            "zeros_rad": axes.shape[:1],
        }
        for field in fields(self)[:-1]:
            array = np.array(getattr(self, field.name), dtype=np.float64)
            expected = shapes.get(field.name, (3,))
            if array.shape != expected:
                raise ValueError(
                    f"geometry: {field.name} has shape {array.shape}, expected "
                    f"{expected}"
                )
            array.setflags(write=False)
            object.__setattr__(self, field.name, array)
        for name in ("axes", "probe_direction"):
            length = np.linalg.norm(getattr(self, name), axis=-1)
            if not np.all(np.abs(length - 1.0) < 1e-9):
                raise ValueError(
                    f"geometry: {name} has lengths {length}, expected unit vectors; "
                    "use unit_vectors()"
                )

    @property
    def n_joints(self) -> int:
        return len(self.zeros_rad)

    def hinge_readings(self, angles_rad: Floats) -> Floats:
        """Return the readings of hinges: (n_samples, n_joints) [rad].

        Args:
            angles_rad: readings, likewise; returned unchanged without couplings.
        """
        if not self.couplings:
            return angles_rad
        hinges_rad = np.array(angles_rad, dtype=np.float64)
        for joint, master, ratio in self.couplings:
            turns_rad = angles_rad[:, master] - self.zeros_rad[master]
            hinges_rad[:, joint] += ratio * turns_rad
        return hinges_rad

    def by_readings(self, by_hinges: Floats) -> Floats:
        """Convert derivatives by hinges into those by readings.

        Args:
            by_hinges: (..., n_joints); returned unchanged without couplings.
        """
        if not self.couplings:
            return by_hinges
        by_readings = by_hinges.copy()
        for joint, master, ratio in self.couplings:
            by_readings[..., master] += ratio * by_hinges[..., joint]
        return by_readings


def unit_vectors(vectors: ArrayLike) -> Floats:
    """Scale vectors to length 1, without overflow.

    Args:
        vectors: (..., 3), none of them zero.

    Returns:
        (..., 3).
    """
    array = np.array(vectors, dtype=np.float64)
    largest = np.max(np.abs(array), axis=-1, keepdims=True)
    if not np.all(largest > 0.0) or not np.all(np.isfinite(largest)):
        raise ValueError(
            f"{array.tolist()} holds a vector without a finite length above zero"
        )
    # Scaled twice, so that squares neither overflow nor vanish.
    array = array / largest
    units: Floats = array / np.linalg.norm(array, axis=-1, keepdims=True)
    return units


def across(
    axis: Floats,
) -> tuple[Floats, Floats]:
    """Span the plane across a unit vector.

    v = normalise(e - (e . u) u) with e the unit vector of the smallest component of
    u, and w = u x v; each (3,).
    """
    smallest = np.eye(3)[np.argmin(np.abs(axis))]
    perpendicular = smallest - float(smallest @ axis) * axis
    first = perpendicular / np.linalg.norm(perpendicular)
    return first, np.cross(axis, first)


def geometry_from_arm(arm: "Arm") -> Geometry:
    """Return the geometry of an arm file.

    Axes and direction are normalised here; an absent direction is along the last link
    plus the probe vector.
    """
    vector_mm = np.array(arm.probe.vector_mm)
    direction = arm.probe.direction
    shank = vector_mm + arm.joints[-1].link_mm if direction is None else direction
    names = [joint.name for joint in arm.joints]
    return Geometry(
        origin_mm=np.array(arm.origin_mm),
        axes=unit_vectors([joint.axis for joint in arm.joints]),
        links_mm=np.array([joint.link_mm for joint in arm.joints]),
        zeros_rad=np.array([joint.zero_rad for joint in arm.joints]),
        probe_vector_mm=vector_mm,
        probe_direction=unit_vectors(shank),
        couplings=tuple(
            Coupling(k, names.index(joint.coupled_to), joint.ratio)
            for k, joint in enumerate(arm.joints)
            if joint.coupled_to is not None and joint.ratio is not None
        ),
    )
