"""What an arm file may ask for that a running daemon cannot do."""

from collections.abc import Mapping

from traverse.kinematics.arm_file.arm import Arm, Problem
from traverse.kinematics.effects.arm_effects import ArmEffects
from traverse.kinematics.effects.base.covariate import Covariate

LARGEST_TIME_S = 9.2e9  # since 1970, in nanoseconds 63 bits


def encoder_problems(arm: Arm, device_ids: Mapping[str, object]) -> list[Problem]:
    """Joints without an encoder, or with one that no device reads."""
    problems = []
    for index, joint in enumerate(arm.joints):
        where = f"joints[{index}].encoder"
        if joint.encoder is None:
            problems.append(
                Problem(where, "is missing; without it counts are not angles")
            )
            continue
        if joint.encoder.device_id not in device_ids:
            known = ", ".join(sorted(device_ids)) or "none"
            problems.append(
                Problem(
                    f"{where}.source",
                    f"names device {joint.encoder.device_id!r}, which the "
                    f"configuration does not have; it has: {known}",
                )
            )
    return problems


_NEVER_KNOWN = {
    Covariate.CAMPAIGN_TIME: "the time since the start of a campaign that is over",
    Covariate.FORCE: "the force of a contact",
}


def covariate_problems(effects: ArmEffects) -> list[Problem]:
    """Effects of something that a running daemon is never told."""
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


def epoch_problems(arm: Arm) -> list[Problem]:
    """Effects bound to moments that the nanoseconds of a sample cannot tell."""
    problems = []
    for index, effect in enumerate(arm.effects):
        if effect.epoch_utc is None:
            continue
        moment_s = effect.epoch_utc.timestamp() + effect.values.get("at_s", 0.0)
        if abs(moment_s) > LARGEST_TIME_S:
            problems.append(
                Problem(
                    f"effects[{index}].epoch_utc",
                    f"{effect.epoch_utc} and at_s, if there is one, are a moment that "
                    "times of samples do not reach, expected 1678 to 2261; correct the "
                    "date",
                )
            )
    return problems
