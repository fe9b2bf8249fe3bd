"""How well the arm file's parameters are known, by the file that it names."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.effects.arm_effects import ArmEffects
from traverse.kinematics.uncertainty.arm_covariance import (
    ArmCovariance,
    parameter_names,
    read_arm_covariance,
)


def read_parameter_covariance(
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


def covariance_with_probe(
    known: ArmCovariance | None,
    arm: Arm,
    in_line: ArmEffects,
    covariance_mm2: NDArray[np.float64] | None,
) -> ArmCovariance | None:
    """What is known with a probe that was not identified together with the arm.

    Args:
        known: with the probe before.
        arm: the arm.
        in_line: its effects.
        covariance_mm2: of the probe's vector, (3, 3), by itself; None: not known.

    Returns:
        None where nothing is known.
    """
    if known is None and covariance_mm2 is None:
        return None
    names = parameter_names(
        [joint.name for joint in arm.joints], in_line.parameter_names
    )
    factor = np.zeros((len(names), 0)) if known is None else known.factor.copy()
    rows = [row for row, name in enumerate(names) if name.startswith("probe.vector.")]
    factor[rows] = 0.0
    if covariance_mm2 is not None:
        values, vectors = np.linalg.eigh(covariance_mm2)
        own = np.zeros((len(names), 3))
        own[rows] = vectors * np.sqrt(np.maximum(values, 0.0))
        factor = np.concatenate([factor, own], axis=1)
    return ArmCovariance(factor)
