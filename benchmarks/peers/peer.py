"""Interface of a peer, and the arm as all of them take it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.model.geometry import Geometry


@dataclass(frozen=True, slots=True)
class Peer:
    """Another library, made ready for one arm.

    Attributes:
        one: turns of one sample, alpha - alpha0, (n_joints,), to the ball's centre in
            whatever form the library returns.
        batch: turns (n_samples, n_joints) to centres (n_samples, 3).
        derivatives: turns to the derivatives by angles, (n_samples, 3, n_joints).
    """

    name: str
    version: str
    one: Callable[[Any], Any] | None = None
    batch: Callable[[Floats], Floats] | None = None
    derivatives: Callable[[Floats], Floats] | None = None


def offsets_mm(geometry: Geometry) -> Floats:
    """Origins of the frames in the one before [mm], the ball last: (n_joints + 1, 3).

    All frames are parallel to the base's in the base posture, so a joint's frame lies
    r_k from the one before and turns about u_k by alpha_k - alpha0_k.
    """
    steps_mm = np.vstack([geometry.origin_mm, geometry.links_mm])
    steps_mm[-1] += geometry.probe_vector_mm
    return steps_mm
