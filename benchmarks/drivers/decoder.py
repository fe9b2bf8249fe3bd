"""The serial decoder against noise and against a corrupted line."""

import random
import struct
import time
import tracemalloc

import numpy as np

from benchmarks.tools.sizes import sized
from traverse.protocol.latch_board.messages import Decoder, SampleBlock
from traverse.simulator.devices.latch_board import wire

READ = 4096
SECONDS = sized(600, 10)
RATE_HZ = 1000
SHARE = 0.01  # of the bytes that are changed


def noise(n_bytes: int = sized(10_000_000, 100_000)) -> str:
    """Random bytes: no exception, nothing kept."""
    data = random.Random(1).randbytes(n_bytes)
    decoder = Decoder()
    tracemalloc.start()
    messages, largest = 0, 0
    for start in range(0, n_bytes, READ):
        messages += len(decoder.feed(data[start : start + READ]))
        largest = max(largest, decoder.pending)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return (
        f"{n_bytes / 1e6:g} MB of noise: {decoder.faults.total()} pieces rejected, "
        f"{decoder.accepted} passed a CRC of 16 bits by chance, {messages} of them "
        f"were taken for messages; at most {largest} bytes kept, peak memory "
        f"{peak / 1e3:.0f} kB"
    )


def corrupted() -> str:
    """A valid stream with a share of its bytes changed: only touched frames go."""
    rng = np.random.default_rng(2)
    decoder = Decoder()
    touched = untouched_lost = invented = wrong = kept = 0
    ended_before = True
    begun_s = time.perf_counter()
    for second in range(SECONDS):
        first = second * RATE_HZ
        seqs = np.arange(first, first + RATE_HZ, dtype=np.uint32)
        counts = rng.integers(0, 2**23, (RATE_HZ, 7), dtype=np.uint32)
        frames = wire.samples(
            0,
            1,
            0,
            seqs=seqs,
            ticks=seqs * 1000,
            counts=counts,
            status=np.zeros((RATE_HZ, 7), np.uint8),
        )
        data = np.frombuffer(b"".join(frames), np.uint8).copy()
        hit = rng.random(len(data)) < SHARE
        data[hit] ^= rng.integers(1, 256, int(hit.sum()), dtype=np.uint8)
        clean = []
        place = 0
        for frame in frames:
            end = place + len(frame)
            # A frame begins after the delimiter of the one before.
            clean.append(ended_before and not hit[place:end].any())
            ended_before = not hit[end - 1]
            place = end
        received: dict[int, tuple[int, ...]] = {}
        for start in range(0, len(data), READ):
            for message in decoder.feed(data[start : start + READ].tobytes()):
                if isinstance(message, SampleBlock):
                    rows = zip(message.seq, message.counts, strict=True)
                    received |= {int(seq): tuple(row.tolist()) for seq, row in rows}
                else:
                    invented += 1
        for row, (seq, is_clean) in enumerate(zip(seqs.tolist(), clean, strict=True)):
            same = received.pop(seq, None)
            touched += not is_clean
            kept += same is not None
            untouched_lost += is_clean and same is None
            wrong += same is not None and same != tuple(counts[row].tolist())
        invented += len(received)
    taken_s = time.perf_counter() - begun_s
    return (
        f"{SECONDS // 60} min of {RATE_HZ} Hz with {SHARE:.0%} of the bytes changed: "
        f"{touched} frames touched, {kept} read, {untouched_lost} untouched frames "
        f"lost, {wrong} read with wrong counts and {invented} invented (a CRC of 16 "
        f"bits lets one broken frame in 65536 pass), {taken_s:.0f} s"
    )


def speed(n_frames: int = sized(200_000, 2_000)) -> str:
    """Compare decoding of whole reads with a loop that decodes frame by frame."""
    seqs = np.arange(n_frames, dtype=np.uint32)
    counts = np.random.default_rng(3).integers(0, 2**23, (n_frames, 7), dtype=np.uint32)
    frames = wire.samples(
        0,
        1,
        0,
        seqs=seqs,
        ticks=seqs,
        counts=counts,
        status=np.zeros((n_frames, 7), "u1"),
    )
    data = b"".join(frames)
    begun_s = time.perf_counter()
    decoder = Decoder()
    read = sum(
        len(message.seq)
        for start in range(0, len(data), READ)
        for message in decoder.feed(data[start : start + READ])
        if isinstance(message, SampleBlock)
    )
    blocks_s = time.perf_counter() - begun_s
    begun_s = time.perf_counter()
    plain = 0
    for segment in data.split(b"\0"):
        body = wire.body_of(segment) if segment else None
        if body is not None:
            struct.unpack_from("<BBBBII7I7B", body)
            plain += 1
    plain_s = time.perf_counter() - begun_s
    if not read == plain == n_frames:
        raise ValueError(f"{read} and {plain} frames read of {n_frames}")
    return (
        f"decoding: {blocks_s / n_frames * 1e6:.2f} us a frame in whole reads, "
        f"{plain_s / n_frames * 1e6:.2f} us one by one in plain Python: "
        f"{plain_s / blocks_s:.1f} times"
    )
