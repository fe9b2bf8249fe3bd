"""From entries of `[[effects]]` to faults."""

from collections.abc import Sequence

import numpy as np

from traverse.arrays import Floats
from traverse.extensions import (
    EFFECT_GROUP,
    LAW_GROUP,
    BrokenExtensionError,
    broken_extension,
    load_extension,
    offered_extensions,
)
from traverse.kinematics.arm_file.arm import Arm, Effect
from traverse.simulator.effects.fault import (
    OF_ARM,
    OF_JOINT,
    BodyFault,
    EffectEntry,
    Fault,
    ReadingFault,
    TouchFault,
)
from traverse.simulator.effects.laws import OF_MASSES, PLAYED
from traverse.strict_toml.problems import FileError, Problem

TIMED = {"encoder_drift", "count_slip", "base_drift", "base_step"}
WEIGHED = {"joint_compliance", "bearing_compliance", "mount_compliance"}
POINTING = {
    "axis_wobble": ("cos_rad", "sin_rad"),
    "axis_runout": ("cos_mm", "sin_mm"),
}
OF_STANDARDS = "artefact_length"


def faults_from_effects(
    arm: Arm, effects: Sequence[Effect], source: str = "arm file"
) -> tuple[Fault, ...]:
    """Make faults, except of standards.

    Messages call the effects ``source``.

    Raises:
        FileError: lists all effects that cannot be played.
    """
    names = tuple(joint.name for joint in arm.joints)
    problems: list[Problem] = []
    faults: list[Fault] = []
    for number, effect in enumerate(effects):
        if effect.kind == OF_STANDARDS:
            continue
        where = f"effects[{number}]"
        if effect.joint is not None and effect.joint not in names:
            message = f"'{effect.joint}' is no joint of this arm: {', '.join(names)}"
            problems.append(Problem(f"{where}.joint", message))
            continue
        joint = -1 if effect.joint is None else names.index(effect.joint)
        entry = EffectEntry(
            kind=effect.kind,
            values=effect.values,
            joints=slice(None) if joint < 0 else slice(joint, joint + 1),
            joint=joint,
            reference_c=arm.reference.temperature_c,
            epoch_utc_s=effect.epoch_utc.timestamp() if effect.epoch_utc else 0.0,
            names=names,
        )
        if effect.kind in WEIGHED and not _has_weight(arm, effects, max(joint, 0)):
            message = f"{effect.kind}: nothing beyond has a mass_kg; add what it weighs"
            problems.append(Problem(where, message))
        elif effect.kind == "empirical" and entry.covariate is None:
            shown = effect.values["covariate"]
            message = (
                f"'{shown}' is no column of a campaign; expected {', '.join(OF_ARM)}, "
                f"or a joint followed by {', '.join(OF_JOINT)}"
            )
            problems.append(Problem(f"{where}.covariate", message))
        elif effect.kind not in PLAYED:
            try:
                faults.append(fault_of_extension(entry))
            except BrokenExtensionError as error:
                problems.append(Problem(f"{where}.kind", str(error)))
        else:
            faults.append(entry)
    if problems:
        raise FileError(source, problems)
    return tuple(faults)


def fault_of_extension(entry: EffectEntry) -> Fault:
    """Make the fault of an effect that another package offers, by its own law.

    Raises:
        BrokenExtensionError: it has no law, or one that makes something else.
    """
    group, kind = LAW_GROUP, entry.kind
    if kind not in offered_extensions(group):
        effects = offered_extensions(EFFECT_GROUP)[kind]
        reason = f"has no law for the simulator; offer one under {group}"
        raise broken_extension(EFFECT_GROUP, effects[0], reason)
    law = load_extension(group, kind, object)
    fault = law(entry) if callable(law) else law
    if isinstance(fault, ReadingFault | BodyFault | TouchFault):
        return fault
    reason = f"makes no ReadingFault, BodyFault or TouchFault but {fault!r}"
    raise broken_extension(group, offered_extensions(group)[kind][0], reason)


def effect_problems(arm: Arm, where: str) -> list[Problem]:
    """Report effects of an arm file that cannot be played, with key paths."""
    try:
        faults_from_effects(arm, arm.effects)
    except FileError as error:
        return [Problem(f"{where} {p.where}", p.message) for p in error.problems]
    return []


def on_true_axes(
    arm: Arm, effects: Sequence[Effect], axes: Floats
) -> tuple[Effect, ...]:
    """Rotate vectors across or along design axes onto the true ones, (n_joints, 3).

    A bearing wanders across its true axis, not across the one on paper.
    """
    names = [joint.name for joint in arm.joints]
    turned: list[Effect] = []
    for effect in effects:
        if effect.kind not in POINTING or effect.joint is None:
            turned.append(effect)
            continue
        axis = axes[names.index(effect.joint)]
        values = {}
        for key in POINTING[effect.kind]:
            vector = np.array(effect.values[key], dtype=np.float64)
            along = float(vector @ axis) * axis
            is_axial = effect.values.get("component") == "axial"
            values[key] = tuple((along if is_axial else vector - along).tolist())
        turned.append(effect.model_copy(update=values))
    return tuple(turned)


def _has_weight(arm: Arm, effects: Sequence[Effect], joint: int) -> bool:
    heavy = {effect.joint for effect in effects if effect.kind == OF_MASSES}
    return arm.probe.mass_kg is not None or any(
        beyond.mass_kg is not None or beyond.name in heavy
        for beyond in arm.joints[joint:]
    )
