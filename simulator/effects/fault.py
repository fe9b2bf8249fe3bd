"""The three classes of faults, by the quantity that they change.

Any fault of one of them can be played, whether an arm file can name it or not.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

from traverse.arrays import Floats
from traverse.simulator.effects.posture import Build, Deflection, Posture, Surroundings


@dataclass(frozen=True, slots=True)
class JointState:
    """The state of an encoder.

    Attributes:
        build: The arm.
        turns_rad: (n, n_joints) of the encoders, true.
        readings_rad: (n, n_joints) what the encoders show, their errors included.
        around: Of every sample.
    """

    build: Build
    turns_rad: Floats
    readings_rad: Floats
    around: Surroundings


@dataclass(frozen=True, slots=True)
class Touch:
    """How the ball touches.

    Attributes:
        build: The arm.
        motion: (n, 4, 4) of the last element, from the base posture.
        towards: (n, 3) from the ball towards the material; zero without contact.
        force_n: (n,)
    """

    build: Build
    motion: Floats
    towards: Floats
    force_n: Floats


@dataclass(frozen=True, slots=True)
class ReadingFault(ABC):
    """Encoders show something else than the turn.

    Attributes:
        joints: Which ones, from 0.
    """

    joints: slice

    @abstractmethod
    def errors_rad(self, seen: JointState) -> Floats:
        """Excess of the reading, (n, n_chosen joints) or (n, 1)."""


class BodyFault(ABC):
    """The arm is not where its hinges indicate."""

    @abstractmethod
    def move(self, posture: Posture, yielding: Deflection) -> None:
        """Add to what has yielded."""


class TouchFault(ABC):
    """The end of the rigid arm is not where the ball should be when it reports."""

    @abstractmethod
    def offsets_mm(self, touch: Touch) -> Floats:
        """From where a perfect ball is to where the arm's end is, (n, 3)."""


Fault = ReadingFault | BodyFault | TouchFault
