"""Installed peers, and comparison of their results."""

from importlib import import_module

import numpy as np

from benchmarks.peers.peer import Peer
from traverse.arrays import Floats
from traverse.kinematics.model.derivatives import numpy_derivatives
from traverse.kinematics.model.forward import numpy_centre
from traverse.kinematics.model.geometry import Geometry

# The quickest known for one pose, for derivatives, for many poses.
MODULES = ("mujoco_bodies", "pinocchio_chain", "scipy_rotations")
AGREEMENT_MM = 1e-9


def installed_peers(geometry: Geometry) -> tuple[list[Peer], list[str]]:
    available, missing = [], []
    for name in MODULES:
        try:
            module = import_module(f"benchmarks.peers.{name}")
        except ImportError:
            missing.append(name)
        else:
            available.append(module.peer(geometry))
    return available, missing


def check_agreement(geometry: Geometry, peer: Peer, angles_rad: Floats) -> float:
    """The largest difference from the definition [mm].

    Args:
        geometry: the arm.
        peer: made ready for it.
        angles_rad: readings, (n_samples, n_joints).

    Raises:
        ValueError: the peer computes something else, so its time would be meaningless.
    """
    turns_rad = angles_rad - geometry.zeros_rad
    differences = []
    expected_mm = numpy_centre(geometry, angles_rad)
    if peer.one is not None:
        centres_mm = [[peer.one(row)[c] for c in range(3)] for row in turns_rad]
        differences.append(centres_mm - expected_mm)
    if peer.batch is not None:
        differences.append(peer.batch(turns_rad) - expected_mm)
    if peer.derivatives is not None:
        by_angles = numpy_derivatives(geometry, angles_rad).by_angles
        differences.append(peer.derivatives(turns_rad) - by_angles)
    largest_mm = max(float(np.abs(difference).max()) for difference in differences)
    if not largest_mm <= AGREEMENT_MM:
        raise ValueError(
            f"{peer.name} {peer.version} is {largest_mm:g} mm off the definition, "
            f"expected at most {AGREEMENT_MM:g}: it computes another arm"
        )
    return largest_mm
