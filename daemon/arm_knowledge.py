"""How well the arm file's parameters are known, by the file that it names."""

from pathlib import Path

from kinematics.arm_covariance import (
    ArmCovariance,
    parameter_names,
    read_arm_covariance,
)
from kinematics.arm_file import Arm
from kinematics.effects.arm_effects import ArmEffects


def read_knowledge(
    path: Path, arm: Arm, effects: ArmEffects, in_line: ArmEffects
) -> ArmCovariance | None:
    """The covariance of the parameters that poses depend on.

    Args:
        path: of the arm file.
        arm: what it says.
        effects: all of it.
        in_line: those of them that correct poses.

    Returns:
        None where the arm file names no such file.

    Raises:
        ValueError: the file is missing, damaged, or of another arm.
    """
    told = arm.identification
    if told is None or told.covariance_file is None:
        return None
    joints = [joint.name for joint in arm.joints]
    names = parameter_names(joints, effects.parameter_names)
    found = read_arm_covariance(
        path.parent / told.covariance_file, names, told.covariance_digest
    )
    places = {name: row for row, name in enumerate(names)}
    kept = parameter_names(joints, in_line.parameter_names)
    return ArmCovariance(found.factor[[places[name] for name in kept]])
