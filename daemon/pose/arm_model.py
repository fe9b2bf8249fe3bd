"""The arm as the pipeline needs it: geometry, effects, encoders and their channels."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from traverse.daemon.pose.model_problems import (
    covariate_problems,
    encoder_problems,
    epoch_problems,
)
from traverse.daemon.pose.parameter_covariance import (
    covariance_with_probe,
    read_parameter_covariance,
)
from traverse.daemon.pose.probe_library import LibraryProbe, with_probe
from traverse.drivers.base.values import Identity
from traverse.kinematics.arm_file.arm import (
    Arm,
    FileError,
    Problem,
    arm_digest,
    read_arm,
)
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects.arm_effects import ArmEffects, effects_from_arm
from traverse.kinematics.effects.base.covariate import Covariate
from traverse.kinematics.model.geometry import Geometry, geometry_from_arm
from traverse.kinematics.model.readings import Encoders, encoders_from_arm
from traverse.kinematics.uncertainty.arm_covariance import ArmCovariance

GRAVITY_EFFECTS = ("joint_compliance", "bearing_compliance", "mount_compliance")


@dataclass(frozen=True, slots=True, eq=False)
class ArmModel:
    """One arm file, ready for the measurement path; replaced whole, never changed.

    Attributes:
        effects: what corrects poses; those of the file that are off-line only are not
            among them.
        reference_temperature_c: where the geometry holds.
        digest: of the arm file's values; every point carries it.
        arm: as its file says it, or with another probe.
        joint_devices: (n_joints,) id of the device that reads each joint.
        channels: (n_joints,) the channel of each joint on its device.
        covariance: of the arm's parameters; None where no file tells it.
    """

    name: str
    digest: str
    geometry: Geometry
    effects: ArmEffects
    reference_temperature_c: float
    encoders: Encoders
    joint_devices: tuple[str, ...]
    channels: NDArray[np.intp]
    probe_radius_mm: float
    arm: Arm
    covariance: ArmCovariance | None = None
    identified_s: float | None = None

    @property
    def devices(self) -> tuple[str, ...]:
        """Ids of the devices that read joints, in the order of the joints."""
        return tuple(dict.fromkeys(self.joint_devices))

    @property
    def per_count_rad(self) -> NDArray[np.float64]:
        """By how much a count changes each reading, (n_joints,)."""
        encoders = self.encoders
        return encoders.signs * (2.0 * np.pi / encoders.counts_per_turn)

    def has_same_encoders(self, other: "ArmModel") -> bool:
        """Whether its joints are read by the same encoders of the same devices."""
        mine, theirs = self.encoders, other.encoders
        return (
            self.joint_devices == other.joint_devices
            and np.array_equal(self.channels, other.channels)
            and np.array_equal(mine.counts_per_turn, theirs.counts_per_turn)
            and np.array_equal(mine.signs, theirs.signs)
        )

    @property
    def uses_temperature(self) -> bool:
        """Whether an effect depends on how warm the arm is."""
        return any(n.covariate is Covariate.TEMPERATURE for n in self.effects.needs)

    @property
    def effect_names(self) -> list[str]:
        """`J3.encoder_eccentricity` and so on, in the order of the arm file."""
        return [self.effects.name(effect) for effect in self.effects.corrections]

    def mismatches_with(self, device: str, identity: Identity) -> list[str]:
        """What does not fit between the arm file and what a device says it has."""
        found = []
        moduli_counts = identity.moduli_counts
        for joint, channel in enumerate(self.channels.tolist()):
            if self.joint_devices[joint] != device:
                continue
            turn = int(self.encoders.counts_per_turn[joint])
            if channel >= len(moduli_counts):
                found.append(
                    f"joint {joint + 1} of the arm is on channel {channel}, but "
                    f"{device} has {len(moduli_counts)} channels, from 0"
                )
                continue
            told = (*identity.counts_per_turn, *[None] * len(moduli_counts))[channel]
            if told not in (None, turn):
                found.append(
                    f"joint {joint + 1} has {turn} counts per turn in the arm file, "
                    f"but channel {channel} of {device} says that it has {told}"
                )
            elif moduli_counts[channel] % turn:
                found.append(
                    f"joint {joint + 1} has {turn} counts per turn in the arm file, "
                    f"but channel {channel} of {device} wraps at "
                    f"{moduli_counts[channel]}, which is no whole number of turns"
                )
        return found


def read_model(path: Path, device_ids: Mapping[str, object]) -> ArmModel:
    """Read an arm file for measuring with the given devices.

    Raises:
        FileError: the file is wrong, or asks for what this daemon cannot do.
    """
    arm = read_arm(path)
    problems = list(encoder_problems(arm, device_ids))
    try:
        effects = effects_from_arm(arm)
    except ValueError as error:
        raise FileError(
            str(path), [*problems, Problem("effects", str(error))]
        ) from None
    problems += [*covariate_problems(effects), *epoch_problems(arm)]
    in_line = _in_line(effects)
    covariance = None
    try:
        covariance = read_parameter_covariance(path, arm, effects, in_line)
    except ValueError as error:
        problems.append(Problem("identification.covariance_file", str(error)))
    if problems:
        raise FileError(str(path), problems)
    encoders = [joint.encoder for joint in arm.joints if joint.encoder is not None]
    return ArmModel(
        arm.name,
        arm_digest(arm),
        geometry_from_arm(arm),
        in_line,
        arm.reference.temperature_c,
        encoders_from_arm(arm),
        tuple(encoder.device_id for encoder in encoders),
        np.array([encoder.channel for encoder in encoders], dtype=np.intp),
        arm.probe.radius_mm,
        arm,
        covariance,
        _identified_s(arm),
    )


def model_with_probe(model: ArmModel, chosen: LibraryProbe) -> ArmModel:
    """The same arm with another probe.

    Raises:
        ValueError: the arm cannot have it; says why.
    """
    weighed = [e.kind for e in model.effects.corrections if e.kind in GRAVITY_EFFECTS]
    if weighed and chosen.mass_kg is None:
        raise ValueError(
            f"{weighed[0]} is an effect of gravity; give the probe its mass_kg"
        )
    arm = with_probe(model.arm, chosen)
    return replace(
        model,
        digest=arm_digest(arm),
        geometry=geometry_from_arm(arm),
        effects=_in_line(effects_from_arm(arm)),
        probe_radius_mm=chosen.radius_mm,
        arm=arm,
        covariance=covariance_with_probe(
            model.covariance, arm, model.effects, chosen.covariance_mm2
        ),
    )


def _identified_s(arm: Arm) -> float | None:
    """When the arm was identified; a date counts from its beginning, in UTC."""
    moment = arm.identification.date if arm.identification else None
    if isinstance(moment, str):
        try:
            moment = datetime.fromisoformat(moment)
        except ValueError:
            return None
    if moment is None:
        return None
    if not isinstance(moment, datetime):
        moment = datetime(moment.year, moment.month, moment.day, tzinfo=UTC)
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def _in_line(effects: ArmEffects) -> ArmEffects:
    """The effects without those that correct no pose, such as a standard's length."""
    kept = [c for c in effects.corrections if EFFECT_KINDS[c.kind].effect_class != "O"]
    return replace(effects, corrections=tuple(kept))
