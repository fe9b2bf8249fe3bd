"""Timed samples: bodies that follow one another become one block."""

import numpy as np

from traverse.protocol.latch_board.messages import SampleBlock

TIMED = b"\x02\x83"
"""How the frame of a timed sample begins, and no other: its type, then a token of 0."""


def _sample_dtype(n_channels: int) -> np.dtype[np.void]:
    return np.dtype(
        [
            ("head", "u1", (3,)),
            ("inputs", "u1"),
            ("seq", "<u4"),
            ("ticks", "<u4"),
            ("counts", "<u4", (n_channels,)),
            ("status", "u1", (n_channels,)),
        ]
    )


_SAMPLE_DTYPES = {n: _sample_dtype(n) for n in range(1, 48)}


def sample_block(bodies: list[bytes]) -> SampleBlock:
    """Bodies of one stream and one length as a block."""
    rows = np.frombuffer(b"".join(bodies), _SAMPLE_DTYPES[(len(bodies[0]) - 12) // 5])
    return SampleBlock(
        bodies[0][2],
        rows["seq"],
        rows["ticks"],
        rows["inputs"],
        rows["counts"],
        rows["status"],
    )
