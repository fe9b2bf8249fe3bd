"""The Robotics Toolbox: elementary transforms."""

import numpy as np
import roboticstoolbox as rtb

from benchmarks.peers.peer import Peer, offsets_mm
from traverse.arrays import Floats
from traverse.kinematics.model.geometry import Geometry


def peer(geometry: Geometry) -> Peer:
    """An `ETS` with each axis turned to z and back; `eval` takes one row or many."""
    steps_mm = offsets_mm(geometry)
    chain = rtb.ETS()
    for k, axis in enumerate(geometry.axes):
        to_axis = np.eye(4)
        to_axis[:3, :3] = _z_to(axis)
        place = np.eye(4)
        place[:3, 3] = steps_mm[k]
        chain = chain * rtb.ET.SE3(place @ to_axis) * rtb.ET.Rz()
        chain = chain * rtb.ET.SE3(to_axis.T)
    end = np.eye(4)
    end[:3, 3] = steps_mm[-1]
    chain = (chain * rtb.ET.SE3(end)).compile()  # joins constants that meet
    evaluate = chain.eval

    def batch(turns_rad: Floats) -> Floats:
        return evaluate(turns_rad)[:, :3, 3]

    def one(turns_rad: Floats) -> Floats:
        return evaluate(turns_rad)[:3, 3]

    return Peer("roboticstoolbox", rtb.__version__, one, batch)


def _z_to(axis: Floats) -> Floats:
    """A rotation that takes z to an axis."""
    other = np.eye(3)[np.argmin(np.abs(axis))]
    x = np.cross(other, axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])
