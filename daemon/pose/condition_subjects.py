"""Which conditions of the table apply to an arm and its devices."""

from collections.abc import Sequence

from traverse.daemon.conditions.table import ARM, CONDITIONS, HOST, Condition
from traverse.daemon.pose.arm_model import ArmModel


def subjects_by_condition(
    model: ArmModel, devices: Sequence[str]
) -> dict[str, tuple[str, ...]]:
    """By name of the condition, the subjects that it applies to.

    ``devices`` are all that are configured; those that read no joint are triggers.
    """
    return {row.name: _subjects(row, model, devices) for row in CONDITIONS}


def counting_subjects(model: ArmModel) -> tuple[str, ...]:
    """The subjects whose conditions mark numbers."""
    return (*model.devices, ARM, HOST)


def _subjects(
    row: Condition, model: ArmModel, devices: Sequence[str]
) -> tuple[str, ...]:
    match row.subject:
        case "host":
            return (HOST,)
        case "arm":
            return (ARM,)
        case "device":
            return tuple(devices if row.name == "present" else model.devices)
