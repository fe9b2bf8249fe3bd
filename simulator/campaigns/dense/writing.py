"""Writes a dense scan as the folder of a campaign, its stream an MCAP file.

Written from the format's description (docs/reference/recordings.md), not with the code
that reads it, so that errors cannot cancel.
"""

import json
import struct
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
from mcap.writer import Writer
from numpy.typing import NDArray

from traverse.kinematics.arm_file.arm import write_arm
from traverse.simulator.campaigns.conditions import stream
from traverse.simulator.campaigns.dense.scan import NOTHING, DenseScan
from traverse.simulator.campaigns.writing import campaign_text, true_arm_file

BLOCK = 500  # samples a message
CONDITIONS_S = 1.0
HOST_NS = 1_000_000_000_000  # of the host's clock at the first sample
TICKS_HZ = 1_000_000
ARRAY = 1  # MessagePack's extension type


def write_scan(folder: Path, scan: DenseScan, seed: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    text = scan_campaign_text(scan)
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    design = scan.arm.model_copy(update={"effects": ()})
    write_arm(folder / "arm.toml", design)
    (folder / "truth").mkdir(exist_ok=True)
    write_arm(folder / "truth" / "arm.toml", true_arm_file(scan.arm, scan.truth))
    arm_text = (folder / "arm.toml").read_text(encoding="utf-8")
    with (folder / "scan.mcap").open("wb") as file:
        writer = Writer(file, chunk_size=1 << 18)
        writer.start("traverse", "traverse simulator")
        joints = json.dumps([joint.name for joint in scan.arm.joints])
        head = {"schema": "traverse/recording/1", "joints": joints}
        writer.add_metadata("traverse", head)
        for name, content in (("arm.toml", arm_text), ("campaign.toml", text)):
            writer.add_attachment(0, 0, name, "application/toml", content.encode())
        _write_stream(writer, scan, seed)
        writer.finish()  # type: ignore[no-untyped-call] # mcap's own


def scan_campaign_text(scan: DenseScan) -> str:
    noise = scan.file.noise
    factor = noise.stated_factor if noise.stated else None
    stds = (noise.encoder_rad, noise.contact_mm)
    stated = (None, None) if factor is None else (factor * stds[0], factor * stds[1])
    start_utc = scan.start_utc.isoformat()
    return campaign_text(scan.artefacts, start_utc, stated, "scan.mcap")


def _write_stream(writer: Writer, scan: DenseScan, seed: int) -> None:
    samples = writer.register_channel("samples", "msgpack", 0)
    touching = writer.register_channel("touching", "json", 0)
    conditions = writer.register_channel("conditions", "json", 0)
    rng = stream(seed, "directions")
    since_ns = np.rint(1e9 * scan.around.time_s).astype(np.int64)
    host_ns = HOST_NS + since_ns
    start_ns = int(scan.start_utc.timestamp()) * 1_000_000_000
    late_s = 1e-4 + scan.file.scan.latch_jitter_s * np.abs(
        rng.standard_normal(len(host_ns))
    )
    columns: dict[str, NDArray[Any]] = {
        "numbers": np.arange(len(host_ns)),
        "device_ticks": since_ns // (1_000_000_000 // TICKS_HZ),
        "received_ns": host_ns + np.rint(1e9 * late_s).astype(np.int64),
        "sample_time_ns": host_ns,
        "utc_ns": start_ns + since_ns,
        "counts": scan.counts,
    }
    changes = set((np.flatnonzero(np.diff(scan.touched)) + 1).tolist()) | {0}
    every = max(round(CONDITIONS_S * scan.file.scan.rate_hz), 1)
    for first in range(0, len(host_ns), BLOCK):
        rows = range(first, min(first + BLOCK, len(host_ns)))
        for row in rows:
            at_ns, log_ns = int(host_ns[row]), int(columns["utc_ns"][row])
            if row in changes:
                index = int(scan.touched[row])
                name = None if index == NOTHING else scan.artefacts[index].id
                table = {"sample_time_ns": at_ns, "artefact": name, "feature": ""}
                writer.add_message(touching, log_ns, json.dumps(table).encode(), log_ns)
            if row in changes or row % every == 0:
                moment = {
                    "sample_time_ns": at_ns,
                    "temperature_c": float(scan.around.temperature_c[row]),
                    "force_n": float(scan.around.force_n[row]),
                }
                writer.add_message(
                    conditions, log_ns, json.dumps(moment).encode(), log_ns
                )
        part = slice(rows.start, rows.stop)
        block = {name: _array(column[part]) for name, column in columns.items()}
        log_ns = int(columns["utc_ns"][first])
        writer.add_message(samples, log_ns, msgpack.packb(block), log_ns)


def _array(values: NDArray[np.integer]) -> msgpack.ExtType:
    """Pack an array as an extension: kind, size, dimensions, their sizes, elements."""
    head = struct.pack("<cBB", values.dtype.kind.encode(), values.itemsize, values.ndim)
    shape = struct.pack(f"<{values.ndim}I", *values.shape)
    little = values.astype(values.dtype.newbyteorder("<"))
    return msgpack.ExtType(ARRAY, head + shape + little.tobytes())
