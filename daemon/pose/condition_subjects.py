"""Subjects of the conditions for an arm and its devices."""

from collections.abc import Mapping

from traverse.daemon.conditions.table import ARM, CONDITIONS, HOST, Condition
from traverse.daemon.config.schema import QualitySection
from traverse.daemon.pose.arm_model import ArmModel
from traverse.drivers.base.values import Identity


def subjects_by_condition(
    model: ArmModel, section: QualitySection, devices: Mapping[str, Identity | None]
) -> dict[str, tuple[str, ...]]:
    """Return the subjects of each condition.

    Args:
        model: the arm.
        section: limits in the configuration.
        devices: all configured ones with their identities; None before they have
            answered. Those that read no joint are triggers.
    """
    absent = {
        "temperature": not model.uses_temperature,
        "temperature_band": section.temperature_low_c is None
        and section.temperature_high_c is None
        and section.temperature_change_c is None
        and model.temperature_limits_c == (None, None),
        "identification_age": section.identification_days is None,
    }
    return {
        row.name: () if absent.get(row.name) else _subjects(row, model, devices)
        for row in CONDITIONS
    }


def _subjects(
    row: Condition, model: ArmModel, devices: Mapping[str, Identity | None]
) -> tuple[str, ...]:
    if row.subject == "host":
        return (HOST,)
    if row.subject == "arm":
        return (ARM,)
    if row.name == "present":
        return tuple(devices)
    if row.name == "identity":  # not of a device that has no serial number
        numbered = {d for d, of in devices.items() if of is None or of.serials}
        return tuple(device for device in model.devices if device in numbered)
    return model.devices
