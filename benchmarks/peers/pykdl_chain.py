"""PyKDL: a chain of segments."""

import PyKDL as kdl  # noqa: N813 - as its own examples have it

from benchmarks.peers.peer import Peer, offsets_mm
from traverse.kinematics.model.geometry import Geometry


def peer(geometry: Geometry) -> Peer:
    """`ChainFkSolverPos_recursive`; its array of joints takes one float at a time."""
    steps_mm = offsets_mm(geometry)
    chain = kdl.Chain()
    fixed = kdl.Joint("base", kdl.Joint.Fixed)
    chain.addSegment(kdl.Segment(fixed, kdl.Frame(kdl.Vector(*steps_mm[0]))))
    for k, axis in enumerate(geometry.axes):
        nowhere, along = kdl.Vector(0, 0, 0), kdl.Vector(*axis)
        joint = kdl.Joint(f"J{k + 1}", nowhere, along, kdl.Joint.RotAxis)
        step = kdl.Frame(kdl.Vector(*steps_mm[k + 1]))
        chain.addSegment(kdl.Segment(joint, step))
    solver = kdl.ChainFkSolverPos_recursive(chain)
    turns, frame = kdl.JntArray(geometry.n_joints), kdl.Frame()

    def one(turns_rad: list[float]) -> object:
        for k, turn_rad in enumerate(turns_rad):
            turns[k] = turn_rad
        solver.JntToCart(turns, frame)
        return frame.p

    # The solver refers to its chain without keeping it.
    return Peer("PyKDL", kdl.__version__, one, takes_list=True, keeps=chain)
