"""Keys of devices on serial lines in the simulator's file."""

from collections.abc import Iterator, Sequence
from typing import ClassVar

from pydantic import Field

from traverse.plurals import counted
from traverse.simulator.devices.table import DeviceTable


class SerialTable(DeviceTable):
    """Base class of devices on serial lines.

    Attributes:
        baud_rate: 0: bytes take no time.
        request_delay_s: added by an adapter from the host.
        reply_delay_s: added by an adapter to the host.
        turnaround_s: from the end of a request to the begin of its answer.
        echo: the host receives its own bytes.
    """

    FAULTS: ClassVar[frozenset[str]] = frozenset(
        [
            "lost",
            "corrupted",
            "repeated",
            "garbage",
            "late",
            "stuck",
            "jump",
            "status",
            "gone",
            "silent",
            "reset",
        ]
    )
    BY_CHANNEL: ClassVar[bool] = True

    baud_rate: int = Field(default=0, ge=0, le=12_000_000)
    request_delay_s: float = Field(default=0.0, ge=0.0, le=1.0)
    reply_delay_s: float = Field(default=0.0, ge=0.0, le=1.0)
    turnaround_s: float = Field(default=0.0, ge=0.0, le=1.0)
    echo: bool = False

    def number_problems(self, key: str, n_joints: int) -> Iterator[tuple[str, str]]:
        """Report a key without one entry for each encoder."""
        n = len(getattr(self, key))
        if n != n_joints:
            yield key, f"{n} given for {counted(n_joints, 'joint')}"

    def bit_problems(
        self, bits: int, multi_turn: int, counts_per_turn: Sequence[int]
    ) -> Iterator[tuple[str, str]]:
        """Report encoders of another width, or of unsupported turns."""
        for channel, counts in enumerate(counts_per_turn):
            if counts != 1 << bits:
                text = f"channel {channel} has {counts} counts per turn in the arm file"
                yield "bits", f"{text}; {bits} bits are {1 << bits}"
        if self.encoder_turns not in {1, multi_turn}:
            text = f"1 for single-turn encoders or {multi_turn} for multi-turn ones"
            yield "encoder_turns", f"expected {text}"
