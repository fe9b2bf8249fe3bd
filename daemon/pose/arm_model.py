"""The arm for the pipeline: geometry, effects, encoders, covariance.

Arm files that need what a running daemon does not know are refused.
"""

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from traverse.arrays import Floats, Indices, Integers
from traverse.daemon.pose.probe_library import LibraryProbe, with_probe
from traverse.drivers.base.values import Identity
from traverse.kinematics.arm_file.arm import (
    Arm,
    arm_digest,
    geometry_digest,
    read_arm,
)
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects.arm_effects import ArmEffects, effects_from_arm
from traverse.kinematics.effects.base.block import Covariate
from traverse.kinematics.model.geometry import Geometry, geometry_from_arm
from traverse.kinematics.model.readings import Encoders, encoders_from_arm
from traverse.kinematics.uncertainty.arm_covariance import (
    ArmCovariance,
    parameter_names,
    read_parameter_covariance,
)
from traverse.plurals import counted
from traverse.protocol.messages.point import Compensation
from traverse.strict_toml.problems import FileError, Problem

log = logging.getLogger("traverse.daemon.service")

LARGEST_TIME_S = 9.2e9  # since 1970, in nanoseconds 63 bits
IDENTIFIED_MARGIN_C = 3.0  # beyond the temperatures of the identification
CORRECTED_MARGIN_C = 15.0  # the same where effects correct for the temperature
WITHOUT_DIRECTION: tuple[Compensation, ...] = ("none", "shank")
_NEVER_KNOWN = {
    Covariate.CAMPAIGN_TIME: "the time since the start of a campaign that is over",
    Covariate.FORCE: "the force of a contact",
}


def covariance_with_probe(
    known: ArmCovariance | None,
    arm: Arm,
    inline_effects: ArmEffects,
    covariance_mm2: Floats | None,
) -> ArmCovariance | None:
    """Return the covariance with a probe that was not identified with the arm.

    ``known`` is with the former probe; ``covariance_mm2`` is of the new probe's vector,
    (3, 3), None if unknown.
    """
    if known is None and covariance_mm2 is None:
        return None
    names = parameter_names(
        [joint.name for joint in arm.joints], inline_effects.parameter_names
    )
    factor = np.zeros((len(names), 0)) if known is None else known.factor.copy()
    rows = [row for row, name in enumerate(names) if name.startswith("probe.vector.")]
    factor[rows] = 0.0
    if covariance_mm2 is not None:
        values, vectors = np.linalg.eigh(covariance_mm2)
        probe_factor = np.zeros((len(names), 3))
        probe_factor[rows] = vectors * np.sqrt(np.maximum(values, 0.0))
        factor = np.concatenate([factor, probe_factor], axis=1)
    return ArmCovariance(factor)


def encoder_problems(arm: Arm, device_ids: Mapping[str, object]) -> Iterator[Problem]:
    """Find joints whose encoder is missing or read by no device."""
    for index, joint in enumerate(arm.joints):
        where = f"joints[{index}].encoder"
        if joint.encoder is None:
            yield Problem(where, "is missing; without it counts are not angles")
        elif joint.encoder.device_id not in device_ids:
            text = (
                f"names device {joint.encoder.device_id!r}, which the configuration "
                f"does not have; it has: {', '.join(sorted(device_ids)) or 'none'}"
            )
            yield Problem(f"{where}.source", text)


def covariate_problems(effects: ArmEffects) -> list[Problem]:
    """Find effects of quantities that a running daemon never knows."""
    return [
        Problem(
            f"effects[{index}]",
            f"{effects.name(effect)} depends on {_NEVER_KNOWN[need.covariate]}, which "
            "a running daemon does not have; measuring without it would give wrong "
            "points. Take it out of the arm file, or diagnose again for an effect "
            "that depends on something else",
        )
        for index, effect in enumerate(effects.corrections)
        for need in effect.needs
        if need.covariate in _NEVER_KNOWN
    ]


def epoch_problems(arm: Arm) -> Iterator[Problem]:
    """Find effects whose moments exceed the range of nanoseconds."""
    for index, effect in enumerate(arm.effects):
        if effect.epoch_utc is None:
            continue
        moment_s = effect.epoch_utc.timestamp() + effect.values.get("at_s", 0.0)
        if abs(moment_s) > LARGEST_TIME_S:
            text = (
                f"{effect.epoch_utc} and at_s, if there is one, are a moment that "
                "times of samples do not reach, expected 1678 to 2261; correct the date"
            )
            yield Problem(f"effects[{index}].epoch_utc", text)


@dataclass(frozen=True, slots=True, eq=False)
class ArmModel:
    """One arm file for the measuring path; immutable.

    Attributes:
        effects: that correct poses; off-line ones are excluded.
        reference_temperature_c: at which the geometry holds.
        digest: of the arm file's values; every point carries it.
        arm: as in its file, or with another probe.
        joint_devices: (n_joints,) id of the device of each joint.
        channels: (n_joints,) channel of each joint on its device.
        covariance: of the arm's parameters; None without a file.
        file_doubt: why the arm file's geometry is in doubt; else empty.
        geometry_doubt: why errors of points are unknown, with the probe in use.
    """

    name: str
    digest: str
    geometry: Geometry
    effects: ArmEffects
    reference_temperature_c: float
    encoders: Encoders
    joint_devices: tuple[str, ...]
    channels: Indices
    probe_radius_mm: float
    arm: Arm
    covariance: ArmCovariance | None = None
    identified_s: float | None = None
    file_doubt: str = ""
    geometry_doubt: str = ""

    @property
    def devices(self) -> tuple[str, ...]:
        """Ids of devices that read joints, in joint order."""
        return tuple(dict.fromkeys(self.joint_devices))

    def joint_of(self, device: str, channel: int) -> str | None:
        for joint, of in enumerate(self.joint_devices):
            if of == device and self.channels[joint] == channel:
                return self.effects.joint_names[joint]
        return None

    @property
    def per_count_rad(self) -> Floats:
        """Change of each reading by one count, (n_joints,)."""
        encoders = self.encoders
        return encoders.signs * (2.0 * np.pi / encoders.counts_per_turn)

    def has_same_encoders(self, other: "ArmModel") -> bool:
        mine, theirs = self.encoders, other.encoders
        return (
            self.joint_devices == other.joint_devices
            and np.array_equal(self.channels, other.channels)
            and np.array_equal(mine.counts_per_turn, theirs.counts_per_turn)
            and np.array_equal(mine.signs, theirs.signs)
        )

    def wraps_counts(self, moduli: Mapping[str, Sequence[int]]) -> Integers:
        """Return where the counts of each joint wrap to 0, (n_joints,).

        Without a modulus of device and channel that is one turn.
        """
        wraps = self.encoders.counts_per_turn.copy()
        for joint, channel in enumerate(self.channels.tolist()):
            known = moduli.get(self.joint_devices[joint], ())
            if channel < len(known) and known[channel] % wraps[joint] == 0:
                wraps[joint] = known[channel]
        return wraps

    @property
    def uses_temperature(self) -> bool:
        return any(n.covariate is Covariate.TEMPERATURE for n in self.effects.needs)

    @property
    def temperature_limits_c(self) -> tuple[float | None, float | None]:
        """Between which the geometry holds, with the effects that correct for it.

        Aluminium grows by 23e-6 a degree: by 0.07 mm at a metre in 3 degrees. With an
        effect of temperature, one that is far from what was measured is wrong, such as
        Fahrenheit of a cold room, or the effect is held too far.
        """
        identified = self.arm.identification
        if identified is None:
            return None, None
        low_c, high_c = identified.temperature_low_c, identified.temperature_high_c
        margin_c = self.temperature_margin_c
        return (
            None if low_c is None else low_c - margin_c,
            None if high_c is None else high_c + margin_c,
        )

    @property
    def temperature_margin_c(self) -> float:
        return CORRECTED_MARGIN_C if self.uses_temperature else IDENTIFIED_MARGIN_C

    @property
    def effect_names(self) -> list[str]:
        """Names such as `J3.encoder_eccentricity`, in the order of the arm file."""
        return [self.effects.name(effect) for effect in self.effects.corrections]

    def mismatches_with(self, device: str, identity: Identity) -> list[str]:
        mismatches = []
        moduli_counts = identity.moduli_counts
        for joint, channel in enumerate(self.channels.tolist()):
            if self.joint_devices[joint] != device:
                continue
            turn = int(self.encoders.counts_per_turn[joint])
            if channel >= len(moduli_counts):
                mismatches.append(
                    f"joint {joint + 1} of the arm is on channel {channel}, but "
                    f"{device} has {counted(len(moduli_counts), 'channel')}, from 0"
                )
                continue
            stated = (*identity.counts_per_turn, *[None] * len(moduli_counts))[channel]
            if stated not in (None, turn):
                mismatches.append(
                    f"joint {joint + 1} has {turn} counts per turn in the arm file, "
                    f"but channel {channel} of {device} reports {stated}"
                )
            elif moduli_counts[channel] % turn:
                mismatches.append(
                    f"joint {joint + 1} has {turn} counts per turn in the arm file, "
                    f"but channel {channel} of {device} wraps at "
                    f"{moduli_counts[channel]}, which is no whole number of turns"
                )
        return mismatches


def read_model(path: Path, device_ids: Mapping[str, object]) -> ArmModel:
    """Read an arm file for measuring with the given devices.

    Raises:
        FileError: the file is wrong or unsuitable for this daemon.
    """
    arm = read_arm(path)
    problems = list(encoder_problems(arm, device_ids))
    try:
        effects = effects_from_arm(arm)
    except ValueError as error:
        raise FileError(path, [*problems, Problem("effects", str(error))]) from None
    problems += [*covariate_problems(effects), *epoch_problems(arm)]
    in_line = _inline_effects(effects)
    covariance = None
    try:
        covariance = read_parameter_covariance(path, arm, effects, in_line)
    except ValueError as error:
        problems.append(Problem("identification.covariance_file", str(error)))
    if problems:
        raise FileError(path, problems)
    encoders = [joint.encoder for joint in arm.joints if joint.encoder is not None]
    doubt = _file_doubt(arm, covariance)
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
        doubt,
        doubt,
    )


def model_with_probe(model: ArmModel, chosen: LibraryProbe) -> ArmModel:
    """Replace the probe.

    Estimated first moments include the former probe; the new one is taken to weigh as
    much.

    Raises:
        ValueError: the arm cannot have it, with the reason.
    """
    weighed = [e.kind for e in model.effects.corrections if e.uses_gravity]
    if model.effects.first_moments and model.arm.probe.mass_kg is None:
        chosen = chosen.model_copy(update={"mass_kg": None})
    elif weighed and chosen.mass_kg is None:
        raise ValueError(
            f"{weighed[0]} is an effect of gravity; give the probe its mass_kg"
        )
    arm = with_probe(model.arm, chosen)
    return replace(
        model,
        digest=arm_digest(arm),
        geometry=geometry_from_arm(arm),
        effects=_inline_effects(effects_from_arm(arm)),
        probe_radius_mm=chosen.radius_mm,
        arm=arm,
        covariance=covariance_with_probe(
            model.covariance, arm, model.effects, chosen.covariance_mm2
        ),
        geometry_doubt=model.file_doubt or _probe_doubt(chosen),
    )


def _file_doubt(arm: Arm, covariance: ArmCovariance | None) -> str:
    if arm.identification is None:
        return f"the arm file of {arm.name} is not the result of an identification"
    if covariance is None or not covariance.factor.any():
        return f"the identification of {arm.name} has no covariance"
    if arm.identification.arm_digest not in (None, geometry_digest(arm)):
        return (
            f"the arm file of {arm.name} has been changed since its identification: "
            "joints, probe, effects or reference are not those that it gave"
        )
    return ""


def _probe_doubt(chosen: LibraryProbe) -> str:
    if chosen.covariance_mm2 is None:
        return f"the library states no vector_covariance_mm2 of probe {chosen.name}"
    return ""


def _identified_s(arm: Arm) -> float | None:
    """Return when the arm was identified; a date means its beginning, in UTC."""
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


def _inline_effects(effects: ArmEffects) -> ArmEffects:
    """Drop effects that correct no pose, such as a standard's length."""
    kept = [c for c in effects.corrections if EFFECT_KINDS[c.kind].effect_class != "O"]
    return replace(effects, corrections=tuple(kept))


def log_model(model: ArmModel, compensation: Compensation) -> None:
    """Log name, digest, effects, and which of them cannot be applied."""
    log.info("arm %s, model %s", model.name, model.digest[:12])
    if names := model.effect_names:
        log.info("effects applied: %s", ", ".join(names))
    if model.effects.contacts and compensation in WITHOUT_DIRECTION:
        log.warning(
            "effects of the contact are left out: `compensation` in [capture] is "
            "not one that finds the direction of the surface (pretouch, pulled, "
            "inside, outside); every point is flagged surface_unknown"
        )
