"""Physical effects beyond the geometry, one file each; `EFFECTS` finds them by kind."""

from collections.abc import Mapping
from types import MappingProxyType

from traverse.kinematics.effects.artefact_length import ArtefactLength
from traverse.kinematics.effects.axis_runout import AxisRunout
from traverse.kinematics.effects.axis_wobble import AxisWobble
from traverse.kinematics.effects.backlash import Backlash
from traverse.kinematics.effects.base_drift import BaseDrift
from traverse.kinematics.effects.base_step import BaseStep
from traverse.kinematics.effects.bearing_compliance import BearingCompliance
from traverse.kinematics.effects.correction import Correction
from traverse.kinematics.effects.count_slip import CountSlip
from traverse.kinematics.effects.empirical import Empirical
from traverse.kinematics.effects.encoder_drift import EncoderDrift
from traverse.kinematics.effects.encoder_eccentricity import EncoderEccentricity
from traverse.kinematics.effects.encoder_harmonic import EncoderHarmonic
from traverse.kinematics.effects.encoder_latency import EncoderLatency
from traverse.kinematics.effects.encoder_scale import EncoderScale
from traverse.kinematics.effects.encoder_temperature import EncoderTemperature
from traverse.kinematics.effects.joint_compliance import JointCompliance
from traverse.kinematics.effects.mount_compliance import MountCompliance
from traverse.kinematics.effects.probe_lobing import ProbeLobing
from traverse.kinematics.effects.probe_radius import ProbeRadius
from traverse.kinematics.effects.stylus_bending import StylusBending
from traverse.kinematics.effects.thermal_expansion import ThermalExpansion

__all__ = ["EFFECTS"]

_KINDS: tuple[type[Correction], ...] = (
    EncoderEccentricity,
    EncoderHarmonic,
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
