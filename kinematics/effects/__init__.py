"""Physical effects beyond the geometry, one file each; `EFFECTS` finds them by kind."""

from collections.abc import Mapping
from types import MappingProxyType

from traverse.kinematics.effects.base.correction import Correction
from traverse.kinematics.effects.contacts.artefact_length import ArtefactLength
from traverse.kinematics.effects.contacts.probe_lobing import ProbeLobing
from traverse.kinematics.effects.contacts.probe_radius import ProbeRadius
from traverse.kinematics.effects.contacts.stylus_bending import StylusBending
from traverse.kinematics.effects.mechanics.axis_runout import AxisRunout
from traverse.kinematics.effects.mechanics.axis_wobble import AxisWobble
from traverse.kinematics.effects.mechanics.base_drift import BaseDrift
from traverse.kinematics.effects.mechanics.base_step import BaseStep
from traverse.kinematics.effects.mechanics.bearing_compliance import BearingCompliance
from traverse.kinematics.effects.mechanics.joint_compliance import JointCompliance
from traverse.kinematics.effects.mechanics.mount_compliance import MountCompliance
from traverse.kinematics.effects.mechanics.thermal_expansion import ThermalExpansion
from traverse.kinematics.effects.readings.backlash import Backlash
from traverse.kinematics.effects.readings.count_slip import CountSlip
from traverse.kinematics.effects.readings.empirical import Empirical
from traverse.kinematics.effects.readings.encoder_drift import EncoderDrift
from traverse.kinematics.effects.readings.encoder_eccentricity import (
    EncoderEccentricity,
)
from traverse.kinematics.effects.readings.encoder_harmonic import EncoderHarmonic
from traverse.kinematics.effects.readings.encoder_latency import EncoderLatency
from traverse.kinematics.effects.readings.encoder_scale import EncoderScale
from traverse.kinematics.effects.readings.encoder_temperature import EncoderTemperature
from traverse.kinematics.effects.readings.transmission_error import TransmissionError

__all__ = ["EFFECTS"]

_KINDS: tuple[type[Correction], ...] = (
    EncoderEccentricity,
    EncoderHarmonic,
    TransmissionError,
    EncoderScale,
    EncoderTemperature,
    EncoderDrift,
    CountSlip,
    EncoderLatency,
    Backlash,
    JointCompliance,
    BearingCompliance,
    MountCompliance,
    ThermalExpansion,
    AxisWobble,
    AxisRunout,
    ProbeRadius,
    ProbeLobing,
    StylusBending,
    BaseDrift,
    BaseStep,
    ArtefactLength,
    Empirical,
)

EFFECTS: Mapping[str, type[Correction]] = MappingProxyType(
    {kind.kind: kind for kind in _KINDS}
)
