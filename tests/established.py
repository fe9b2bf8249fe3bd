"""What tests need that a measurement is `ok`: identified arms, confirmed devices and
a computer's time that was confirmed, which not every machine keeps synchronised.

Covariances are tiny, so that they change no figure that a test asserts.
"""

import json
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.references.memory import (
    ConfirmedDevice,
    ReferenceMemory,
    encoders_text,
)
from traverse.daemon.state_dir import UTC
from traverse.drivers.base.values import Identity
from traverse.kinematics.arm_file.arm import Identification, read_arm, write_arm
from traverse.kinematics.effects.arm_effects import effects_from_arm
from traverse.kinematics.uncertainty.arm_covariance import parameter_names

COVARIANCE_FILE = "arm.cov.npz"
TINY_MM = 1e-9


def identify(path: Path, deviation: float = TINY_MM) -> Path:
    """Give an arm file a covariance beside it, of independent parameters."""
    arm = read_arm(path)
    names = parameter_names(
        [joint.name for joint in arm.joints], effects_from_arm(arm).parameter_names
    )
    file = path.with_suffix(".cov.npz")
    np.savez(
        file,
        names=np.array(names),
        values=np.zeros(len(names)),
        covariance=np.eye(len(names)) * deviation**2,
    )
    reference = arm.identification or Identification()
    known = reference.model_copy(update={"covariance_file": file.name})
    write_arm(path, arm.model_copy(update={"identification": known}))
    return path


def believe_utc(folder: Path) -> None:
    """Let the daemons of a folder know the computer's time, as it was confirmed."""
    state = folder / "state"
    state.mkdir(mode=0o700, exist_ok=True)
    (state / UTC).write_text(json.dumps({"good_ns": time.time_ns()}), "utf-8")


def confirmed(model: ArmModel, devices: Mapping[str, Identity]) -> ReferenceMemory:
    return ReferenceMemory(
        {
            name: ConfirmedDevice(
                encoders_text(model, name, identity.moduli_counts),
                identity.serials,
                identity.boot,
            )
            for name, identity in devices.items()
            if name in model.devices
        }
    )
