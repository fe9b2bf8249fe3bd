"""Physical effects beyond the geometry, one file each; `EFFECTS` finds them by kind."""

from collections.abc import Mapping
from types import MappingProxyType

from kinematics.effects.artefact_length import ArtefactLength
from kinematics.effects.axis_runout import AxisRunout
from kinematics.effects.axis_wobble import AxisWobble
from kinematics.effects.backlash import Backlash
from kinematics.effects.base_drift import BaseDrift
from kinematics.effects.base_step import BaseStep
from kinematics.effects.bearing_compliance import BearingCompliance
from kinematics.effects.correction import Correction
from kinematics.effects.count_slip import CountSlip
from kinematics.effects.empirical import Empirical
from kinematics.effects.encoder_drift import EncoderDrift
from kinematics.effects.encoder_eccentricity import EncoderEccentricity
from kinematics.effects.encoder_harmonic import EncoderHarmonic
from kinematics.effects.encoder_latency import EncoderLatency
from kinematics.effects.encoder_scale import EncoderScale
from kinematics.effects.encoder_temperature import EncoderTemperature
from kinematics.effects.joint_compliance import JointCompliance
from kinematics.effects.mount_compliance import MountCompliance
from kinematics.effects.probe_lobing import ProbeLobing
from kinematics.effects.probe_radius import ProbeRadius
from kinematics.effects.stylus_bending import StylusBending
from kinematics.effects.thermal_expansion import ThermalExpansion

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
