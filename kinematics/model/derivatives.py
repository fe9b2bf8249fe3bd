"""Derivatives of the ball's centre by every parameter of the arm, in closed form.

With o_k the origin of joint k and P_k the rotation of the element that it carries,

    dx/dalpha_k = z_k x (x - o_k),        z_k = P_k u_k the axis where it is now
    dx/dr_k     = P_k
    dx/du_k     = ((P_(k-1) - P_k) (u_k x e)) x (x - o_k)

the last one for each column e of I - u_k u_k^T: an axis is a unit vector, so only its
tangent perturbations count. The last body turns by the same small vectors without their
levers: z_k dalpha_k and (P_(k-1) - P_k) (u_k x e).

`numpy_derivatives` is the readable definition, and computes where the kernel in C was
not built or is disabled.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.model.forward import chunks
from traverse.kinematics.model.geometry import Geometry
from traverse.kinematics.model.kernel_choice import checked_readings, compiled_chain
from traverse.kinematics.model.quaternion import chain_rotations, cross, rotate, turn

# Samples computed at a time: 1.3 kB each for seven joints.
_CHUNK_SAMPLES = 2048


@dataclass(frozen=True, slots=True, eq=False)
class ProbeDerivatives:
    """The ball's centres and their derivatives; second index the component of x.

    Attributes:
        centres_mm: x, (n_samples, 3).
        by_angles: For readings, mm/rad, (n_samples, 3, n_joints).
        by_axes: mm, (n_samples, 3, n_joints, 3); last index the component of u_k,
            which is renormalised: the derivative along u_k itself is zero.
        by_links: P_k, (n_samples, 3, n_joints, 3); last index the component of r_k.
    """

    centres_mm: Floats
    by_angles: Floats
    by_axes: Floats
    by_links: Floats

    @property
    def by_zeros(self) -> Floats:
        """The derivatives for zero_rad in mm/rad, (n_samples, 3, n_joints)."""
        return -self.by_angles

    @property
    def by_probe_vector(self) -> Floats:
        """P_n, the derivatives for the probe vector, (n_samples, 3, 3)."""
        return self.by_links[:, :, -1, :]

    @property
    def by_origin(self) -> Floats:
        """The derivatives for x_0: ones on the diagonal, (n_samples, 3, 3)."""
        return np.broadcast_to(np.eye(3), (len(self.centres_mm), 3, 3))


def probe_derivatives(geometry: Geometry, angles_rad: Floats) -> ProbeDerivatives:
    """Compute the ball's centres and their derivatives for one block of samples.

    Memory is 1.3 kB a sample for seven joints and some times that while computing;
    `derivative_chunks` iterates over long series.

    Args:
        geometry: The arm.
        angles_rad: Readings, (n_samples, n_joints).
    """
    angles_rad = checked_readings(geometry, angles_rad)
    chain = compiled_chain(geometry)
    if chain is None:
        derivatives = numpy_derivatives(geometry, angles_rad)
    else:
        derivatives = ProbeDerivatives(*chain.derivatives(angles_rad))
    return replace(derivatives, by_angles=geometry.by_readings(derivatives.by_angles))


def turn_derivatives(
    geometry: Geometry, derivatives: ProbeDerivatives
) -> tuple[Floats, Floats]:
    """Compute derivatives of the last body's turn from the rotations of all bodies.

    Returns:
        Small turns by readings, rad/rad, (n_samples, 3, n_joints), and by axes, rad,
        (n_samples, 3, n_joints, 3), indexed as for the ball's centre.
    """
    rotations = derivatives.by_links.swapaxes(1, 2)
    by_hinges = np.einsum("nkij,kj->nik", rotations, geometry.axes)
    before = np.empty_like(rotations)
    before[:, 0] = np.eye(3)
    before[:, 1:] = rotations[:, :-1]
    # Columns u_k x e of each unit vector e.
    across = np.cross(geometry.axes[:, np.newaxis], np.eye(3)).swapaxes(1, 2)
    by_axes = ((before - rotations) @ across).swapaxes(1, 2)
    return geometry.by_readings(by_hinges), by_axes


def numpy_derivatives(geometry: Geometry, angles_rad: Floats) -> ProbeDerivatives:
    """Compute `probe_derivatives` without couplings, in NumPy."""
    axes = geometry.axes.T[:, :, np.newaxis]
    turns_rad = np.ascontiguousarray((angles_rad - geometry.zeros_rad).T)
    # after[:, k] is P_k, everything (4, n_joints, n_samples).
    after = chain_rotations(turn(axes, turns_rad))
    links_mm = geometry.links_mm.copy()
    links_mm[-1] += geometry.probe_vector_mm
    steps_mm = rotate(after, links_mm.T[:, :, np.newaxis])
    # Lever arm of joint k: x - o_k, (3, n_joints, n_samples).
    arms_mm = np.cumsum(steps_mm[:, ::-1], axis=1)[:, ::-1]
    by_angles = cross(rotate(after, axes), arms_mm)
    columns = np.eye(3)[:, :, np.newaxis, np.newaxis]
    by_links = rotate(after[:, np.newaxis], columns)
    by_axes = _by_axes(axes, by_links, arms_mm)
    centres_mm = geometry.origin_mm[:, np.newaxis] + arms_mm[:, 0]
    return ProbeDerivatives(
        np.ascontiguousarray(centres_mm.T),
        np.ascontiguousarray(by_angles.transpose(2, 0, 1)),
        np.ascontiguousarray(by_axes.transpose(3, 0, 2, 1)),
        np.ascontiguousarray(by_links.transpose(3, 0, 2, 1)),
    )


def derivative_chunks(
    geometry: Geometry, angles_rad: Floats, chunk_samples: int = _CHUNK_SAMPLES
) -> Iterator[tuple[slice, ProbeDerivatives]]:
    """Yield derivatives of long series with bounded memory.

    Args:
        geometry: the arm.
        angles_rad: readings, (n_samples, n_joints).
        chunk_samples: most samples in a block.

    Yields:
        The samples, and their derivatives.
    """
    for part in chunks(len(angles_rad), chunk_samples):
        yield part, probe_derivatives(geometry, angles_rad[part])


def _by_axes(axes: Floats, rotations: Floats, arms_mm: Floats) -> Floats:
    """Differentiate by the axes: (3 of x, 3 of u, n_joints, n_samples).

    An axis that tilts by e, across it, turns by the small vector u x e the part
    before its own rotation, and back the part behind it:
    dx = ((P_(k-1) - P_k) (u x e)) x (x - o_k). The component of e along u drops out.

    Args:
        axes: u_k, (3, n_joints, 1).
        rotations: P_k as matrices, (3, 3, n_joints, n_samples).
        arms_mm: x - o_k, (3, n_joints, n_samples).
    """
    before = np.empty_like(rotations)
    before[:, :, 0] = np.eye(3)[:, :, np.newaxis]
    before[:, :, 1:] = rotations[:, :, :-1]
    of_x, of_y, of_z = (before - rotations).swapaxes(0, 1)
    ux, uy, uz = axes
    tilts = [of_y * uz - of_z * uy, of_z * ux - of_x * uz, of_x * uy - of_y * ux]
    return np.stack([cross(tilt, arms_mm) for tilt in tilts], axis=1)
