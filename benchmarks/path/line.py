"""Bytes of a board with seven encoders during a timed scan."""

import numpy as np

from traverse.daemon.pose.arm_model import ArmModel
from traverse.simulator.devices.latch_board import wire

RATE_HZ = 10_000.0
TICKS = 1_000_000  # a second


def line_bytes(n_samples: int, model: ArmModel) -> bytes:
    """The frames of so many samples, one every 100 us, all joints trembling."""
    turns = model.encoders.counts_per_turn
    start = np.round(model.encoders.zeros_rad / (2.0 * np.pi) * turns)
    steps = np.random.default_rng(4).normal(0.0, 50.0, (n_samples, len(turns)))
    counts = (start * model.encoders.signs + np.cumsum(steps, axis=0)) % turns
    seqs = np.arange(n_samples, dtype=np.uint32)
    frames = wire.samples(
        0,
        1,
        0,
        seqs=seqs,
        ticks=seqs * np.uint32(TICKS / RATE_HZ),
        counts=counts.astype(np.uint32),
        status=np.zeros((n_samples, len(turns)), np.uint8),
    )
    return b"".join(frames)


def cut(data: bytes, n_bytes: int) -> list[bytes]:
    return [data[start : start + n_bytes] for start in range(0, len(data), n_bytes)]
