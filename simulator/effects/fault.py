"""Faults: entries of an arm file, and three classes by the quantity that they change.

`laws` has the laws of entries; any fault of a class can be played beside it, whether an
arm file can name it or not.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.simulator.effects.posture import Build, Deflection, Posture, Surroundings


@dataclass(frozen=True, slots=True)
class JointState:
    """The state of an encoder.

    Attributes:
        turns_rad: (n, n_joints) of the encoders, true.
        readings_rad: (n, n_joints) of the encoders, errors included.
    """

    build: Build
    turns_rad: Floats
    readings_rad: Floats
    around: Surroundings


@dataclass(frozen=True, slots=True)
class Touch:
    """How the ball touches.

    Attributes:
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
        joints: concerned, from 0.
    """

    joints: slice

    @abstractmethod
    def errors_rad(self, state: JointState) -> Floats:
        """Return the excess of the reading, (n, n_chosen joints) or (n, 1)."""


class BodyFault(ABC):
    """The arm is not where its hinges indicate."""

    @abstractmethod
    def move(self, posture: Posture, yielding: Deflection) -> None:
        """Add to the deflection."""


class TouchFault(ABC):
    """The end of the rigid arm is off the ball's place when it reports."""

    @abstractmethod
    def offsets_mm(self, touch: Touch) -> Floats:
        """Return the way from a perfect ball to the arm's end, (n, 3)."""


OF_JOINT = ("_temperature_c", "_speed_rad_s", "_approach", "_rad")
OF_ARM = ("time_s", "temperature_c", "force_n")


@dataclass(frozen=True, slots=True)
class EffectEntry:
    """An effect of an arm file, resolved.

    Attributes:
        values: of the keys of its kind.
        joints: concerned, from 0; all if it names none.
        joint: concerned; -1 if it names none.
        epoch_utc_s: since 1970; 0 if it has none.
        names: of the arm's joints.
    """

    kind: str
    values: Mapping[str, Any]
    joints: slice
    joint: int
    reference_c: float
    epoch_utc_s: float
    names: tuple[str, ...]

    def __getitem__(self, key: str) -> float:
        number: float = self.values[key]
        return number

    def array(self, key: str) -> Floats:
        return np.array(self.values[key], dtype=np.float64)

    @property
    def covariate(self) -> tuple[str, int] | None:
        """Column and joint (-1 for none) of an empirical effect, if there is such."""
        name = str(self.values["covariate"])
        if name in OF_ARM:
            return name, -1
        for number, joint in enumerate(self.names):
            if name.startswith(joint) and name.removeprefix(joint) in OF_JOINT:
                return name.removeprefix(joint), number
        return None


Fault = EffectEntry | ReadingFault | BodyFault | TouchFault
