"""Faults that make a real arm differ from its geometry, played forwards.

Inputs are true turns of the hinges; outputs are readings of encoders and true places of
the ball. The corrections of an arm file go the other way; only the table of an
`[[effects]]` entry is shared with them.
"""

from traverse.simulator.effects.fault import BodyFault, Fault, ReadingFault, TouchFault
from traverse.simulator.effects.faulty_arm import FaultyArm, MissedContactError
from traverse.simulator.effects.from_arm import (
    effect_problems,
    faults_from_effects,
    on_true_axes,
)
from traverse.simulator.effects.posture import Surroundings
from traverse.simulator.effects.reading_faults import (
    Bump,
    CrossCoupling,
    CubicError,
    JumpInAngle,
    Sawtooth,
    SquareOfTemperature,
)
