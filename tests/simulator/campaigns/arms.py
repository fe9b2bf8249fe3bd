"""Arms for campaigns, and where their balls are by the paper's formula."""

import numpy as np
from scipy.spatial.transform import Rotation

from tests.simulator.conftest import seven_text
from traverse.kinematics.arm_file.arm import Arm, parse_arm


def seven_joint_arm() -> Arm:
    return parse_arm(seven_text())


def six_joint_arm() -> Arm:
    arm = seven_joint_arm()
    return arm.model_copy(update={"joints": arm.joints[:2] + arm.joints[3:]})


def coupled(arm: Arm, **couplings: tuple[str, float]) -> Arm:
    """Couple joints to others: names and ratios."""
    joints = [
        joint.model_copy(
            update=dict(
                zip(("coupled_to", "ratio"), couplings[joint.name], strict=True)
            )
        )
        if joint.name in couplings
        else joint
        for joint in arm.joints
    ]
    return arm.model_copy(update={"joints": tuple(joints)})


def ball_centres_mm(arm: Arm, readings_rad: np.ndarray) -> np.ndarray:
    """x = x0 + sum P_k r_k, P_k = R_1 ... R_k: vectors only, one pose at a time."""
    centres = []
    for readings in readings_rad:
        place_mm = np.array(arm.origin_mm)
        turned = Rotation.identity()
        for joint, reading in zip(arm.joints, readings, strict=True):
            axis = np.array(joint.axis) / np.linalg.norm(joint.axis)
            turn = reading - joint.zero_rad
            for other, shown in zip(arm.joints, readings, strict=True):
                if other.name == joint.coupled_to:
                    turn += joint.ratio * (shown - other.zero_rad)
            turned *= Rotation.from_rotvec(turn * axis)
            place_mm = place_mm + turned.apply(joint.link_mm)
        centres.append(place_mm + turned.apply(arm.probe.vector_mm))
    return np.array(centres)
