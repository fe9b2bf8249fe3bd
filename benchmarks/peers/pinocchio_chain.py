"""pinocchio: a model of hinges about any axis."""

import numpy as np
import pinocchio as pin

from benchmarks.peers.peer import Peer, offsets_mm
from traverse.arrays import Floats
from traverse.kinematics.model.geometry import Geometry


def peer(geometry: Geometry) -> Peer:
    """`forwardKinematics`, then the frame of the ball."""
    steps_mm = offsets_mm(geometry)
    model, joint = pin.Model(), 0
    for k, axis in enumerate(geometry.axes):
        turning = pin.JointModelRevoluteUnaligned(axis)
        placement = pin.SE3(np.eye(3), steps_mm[k])
        joint = model.addJoint(joint, turning, placement, f"J{k + 1}")
    end = pin.SE3(np.eye(3), steps_mm[-1])
    ball = model.addFrame(pin.Frame("ball", joint, end, pin.FrameType.OP_FRAME))
    data = model.createData()
    kinematics, update = pin.forwardKinematics, pin.updateFramePlacement
    jacobian, local = pin.computeFrameJacobian, pin.LOCAL_WORLD_ALIGNED

    def single(turns_rad: Floats) -> Floats:
        kinematics(model, data, turns_rad)
        return update(model, data, ball).translation

    def batch(turns_rad: Floats) -> Floats:
        centres_mm = np.empty((len(turns_rad), 3))
        for row, sample in enumerate(turns_rad):
            kinematics(model, data, sample)
            centres_mm[row] = update(model, data, ball).translation
        return centres_mm

    def derivatives(turns_rad: Floats) -> Floats:
        jacobians = np.empty((len(turns_rad), 3, geometry.n_joints))
        for row, sample in enumerate(turns_rad):
            jacobians[row] = jacobian(model, data, sample, ball, local)[:3]
        return jacobians

    return Peer("pinocchio", pin.__version__, single, batch, derivatives)
