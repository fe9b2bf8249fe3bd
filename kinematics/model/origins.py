"""Origins of joints near the arm.

The origin of a joint may be anywhere on its hinge: x stays where it is under
r_(k-1) -> r_(k-1) + a u_k, r_k -> r_k - a u_k. Tables put it at the foot of the common
normal of two hinges, which for hinges that are nearly parallel is hundreds of metres
away (every arm that was calibrated in the factory), and sums of links say nothing about
the arm's reach then.
"""

from dataclasses import replace

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.model.geometry import Geometry

# Nearer than this (6 degrees) hinges are taken as parallel.
_PARALLEL_SINE = 0.1
# Origins are far where the links are together longer than this many times the shortest.
_FAR = 2.0


def length_mm(geometry: Geometry) -> float:
    """Return the length of all links, stretched out, with the probe."""
    links_mm = geometry.links_mm.copy()
    links_mm[-1] += geometry.probe_vector_mm
    return float(np.linalg.norm(links_mm, axis=1).sum())


def near_origins(geometry: Geometry) -> Geometry:
    """Slide origins that are far from the arm along their hinges; moves nothing.

    From the second joint on to the foot of the common normal with the hinge before, or
    for hinges nearly parallel to where the one before is. Origins that are near stay.
    """
    slid = slid_origins(geometry)
    return slid if length_mm(geometry) > _FAR * length_mm(slid) else geometry


def slid_origins(geometry: Geometry) -> Geometry:
    """Slide all origins but the first as `near_origins` does."""
    ends_mm = geometry.origin_mm + np.vstack(
        [np.zeros(3), np.cumsum(geometry.links_mm, axis=0)]
    )
    places_mm = [ends_mm[0]]
    for k in range(1, geometry.n_joints):
        before, axis = geometry.axes[k - 1], geometry.axes[k]
        cross = np.cross(before, axis)
        sine = float(np.linalg.norm(cross))
        if sine < _PARALLEL_SINE:
            along_mm = float((places_mm[-1] - ends_mm[k]) @ axis)
        else:
            gap_mm = ends_mm[k] - places_mm[-1]
            along_mm = float(np.cross(gap_mm, before) @ cross) / sine**2
        places_mm.append(ends_mm[k] + along_mm * axis)
    links_mm = np.diff(np.array([*places_mm, ends_mm[-1]]), axis=0)
    return replace(geometry, links_mm=links_mm)


def slides_mm(geometry: Geometry, slid: Geometry) -> Floats:
    """Return by how much each origin was slid, as vectors, (n_joints, 3)."""
    moved_mm = np.cumsum(slid.links_mm - geometry.links_mm, axis=0)[:-1]
    return np.vstack([np.zeros((1, 3)), moved_mm])
