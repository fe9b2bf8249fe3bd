"""Contents of a recording, as values."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, FiniteFloat

from traverse.arrays import Integers


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Timed samples as the encoders gave them, one a row.

    Attributes:
        numbers: Rising; a gap is a loss, (n,).
        device_ticks: The device's own counter, unwrapped, (n,).
        received_ns: Host monotonic time right after the read, (n,).
        sample_time_ns: Host monotonic time of the latch, rising, (n,).
        utc_ns: The latch, since 1970, (n,).
        counts: Raw, 0 to counts_per_turn - 1, (n, n_joints).
    """

    numbers: Integers
    device_ticks: Integers
    received_ns: Integers
    sample_time_ns: Integers
    utc_ns: Integers
    counts: NDArray[np.uint32]

    def __post_init__(self) -> None:
        n = len(self.counts)
        for name in TIMES:
            shape = getattr(self, name).shape
            if shape != (n,):
                raise ValueError(f"samples: {name} has shape {shape}, expected ({n},)")
        if self.counts.ndim != 2:
            raise ValueError(
                f"samples: counts have shape {self.counts.shape}, expected "
                "(n, n_joints)"
            )

    def __len__(self) -> int:
        return len(self.counts)

    def part(self, rows: slice) -> "Samples":
        times = {name: getattr(self, name)[rows] for name in TIMES}
        return Samples(**times, counts=self.counts[rows])


Nanoseconds = Annotated[int, Field(gt=-(2**63), lt=2**63)]
TIMES = ("numbers", "device_ticks", "received_ns", "sample_time_ns", "utc_ns")


@dataclass(frozen=True, slots=True)
class Touching:
    """Artefact and feature touched from a moment on, until the next such value.

    Attributes:
        artefact: Its id in the campaign; None: nothing is touched from here on.
        feature: Of the artefact, empty where it has only one.
    """

    sample_time_ns: Nanoseconds
    artefact: str | None = None
    feature: str = ""


@dataclass(frozen=True, slots=True)
class Conditions:
    """How warm it is and how hard is pressed at a moment.

    Attributes:
        temperature_c: Of the arm, or None.
        force_n: Of the contact, or None.
    """

    sample_time_ns: Nanoseconds
    temperature_c: FiniteFloat | None = None
    force_n: FiniteFloat | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A whole recording.

    Attributes:
        joints: Names, from the base outwards.
        arm_text: The arm file that was in force.
        campaign_text: `campaign.toml`, or None.
        samples: In the order of time.
        touching: In the order of time.
        conditions: In the order of time.
        tear: Why the file could not be read to its end, or None.
    """

    joints: tuple[str, ...]
    arm_text: str
    campaign_text: str | None
    samples: Samples
    touching: tuple[Touching, ...]
    conditions: tuple[Conditions, ...]
    tear: str | None = None
