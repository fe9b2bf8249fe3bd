"""One pose at a time with low latency: in C, or in plain Python floats.

NumPy needs fifty times as long for one operation on a single sample.
"""

from collections.abc import Callable, Sequence
from math import cos, nan, sin

from traverse.arrays import Floats
from traverse.kinematics.model.geometry import Geometry
from traverse.kinematics.model.kernel_choice import compiled_chain

Vector = tuple[float, float, float]
Pose = tuple[Vector, Vector]
_NOWHERE: Vector = (nan, nan, nan)


def pose_function(
    geometry: Geometry,
) -> Callable[[Sequence[float] | Floats], Pose]:
    """Make the function from one sample's readings to centre and direction.

    Returns:
        Takes n_joints readings in rad, best as a list; returns the ball's centre in mm
        and the shank's direction, three floats each.
    """
    chain = compiled_chain(geometry)
    pose = PlainChain(geometry).pose if chain is None else chain.pose
    if not geometry.couplings:
        return pose
    zeros_rad = geometry.zeros_rad.tolist()

    def coupled_pose(angles_rad: Sequence[float] | Floats) -> Pose:
        hinges_rad = [float(alpha) for alpha in angles_rad]
        for joint, master, ratio in geometry.couplings:
            hinges_rad[joint] += ratio * (float(angles_rad[master]) - zeros_rad[master])
        return pose(hinges_rad)

    return coupled_pose


class PlainChain:
    """An arm for one sample at a time, in plain floats."""

    def __init__(self, geometry: Geometry) -> None:
        links_mm = geometry.links_mm.copy()
        links_mm[-1] += geometry.probe_vector_mm
        # From the tip inwards, as `pose` does.
        self._joints: list[tuple[float, ...]] = [
            (zero_rad, *axis, *link_mm)
            for zero_rad, axis, link_mm in zip(
                geometry.zeros_rad.tolist(),
                geometry.axes.tolist(),
                links_mm.tolist(),
                strict=True,
            )
        ][::-1]
        self._origin_mm: list[float] = geometry.origin_mm.tolist()
        self._direction: list[float] = geometry.probe_direction.tolist()

    def pose(self, angles_rad: Sequence[float] | Floats) -> Pose:
        """Compute the centre and the direction, three floats each.

        v <- R(u_k, theta_k) (r_k + v) with R(u, a) w = w cos a + (u x w) sin a
        + u (u . w) (1 - cos a), and the direction likewise.
        """
        if len(angles_rad) != len(self._joints):
            raise ValueError(
                f"angles_rad is {angles_rad!r}, expected {len(self._joints)} floats: "
                "one for each joint of the arm"
            )
        x = y = z = 0.0
        i, j, k = self._direction
        for alpha, (zero, ux, uy, uz, rx, ry, rz) in zip(
            reversed(angles_rad), self._joints, strict=True
        ):
            theta = float(alpha) - zero
            try:
                s, c = sin(theta), cos(theta)
            except ValueError:  # infinite
                return _NOWHERE, _NOWHERE
            x, y, z = x + rx, y + ry, z + rz
            t = (1.0 - c) * (ux * x + uy * y + uz * z)
            x, y, z = (
                c * x + s * (uy * z - uz * y) + t * ux,
                c * y + s * (uz * x - ux * z) + t * uy,
                c * z + s * (ux * y - uy * x) + t * uz,
            )
            t = (1.0 - c) * (ux * i + uy * j + uz * k)
            i, j, k = (
                c * i + s * (uy * k - uz * j) + t * ux,
                c * j + s * (uz * i - ux * k) + t * uy,
                c * k + s * (ux * j - uy * i) + t * uz,
            )
        ox, oy, oz = self._origin_mm
        return (ox + x, oy + y, oz + z), (i, j, k)
