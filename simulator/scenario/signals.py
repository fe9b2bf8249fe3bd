"""Values exchanged with a device: events of its inputs, frames that it sends."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from traverse.simulator.scenario.script import ScriptEvent


@dataclass(frozen=True, slots=True)
class InputChange:
    """A new level of an input (1 active, 0 not), by an event of the script."""

    time_s: float
    input_number: int
    level: int
    event: ScriptEvent | None = None


@dataclass(frozen=True, slots=True)
class LatchedEdge:
    """An edge with the readings latched at its first change.

    Attributes:
        inputs: levels of all inputs right after it, as bits.
        counts: (n_channels,)
        status: (n_channels,)
        event: of the script that caused it.
    """

    time_s: float
    input_number: int
    level: int
    inputs: int
    ticks: int
    counts: NDArray[np.uint32]
    status: NDArray[np.uint8]
    event: ScriptEvent | None = None


@dataclass(frozen=True, slots=True)
class AlarmChange:
    """Begin or end of an encoder's alarm."""

    time_s: float
    channel: int
    state: int
    code: int
    value: int


@dataclass(frozen=True, slots=True)
class OutgoingFrame:
    """A frame on its way out; only samples may be dropped."""

    is_sample: bool
    data: bytes
