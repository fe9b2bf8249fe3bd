"""`python -m benchmarks.service.effects [FILE] [SECONDS]`: cost of effects."""

import asyncio
import statistics
import tempfile
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.service.stream import follow_scan
from benchmarks.tools import rig
from benchmarks.tools.command_line import run_main
from benchmarks.tools.rounds import load, write_json
from benchmarks.tools.sizes import sized
from traverse.kinematics.arm_file.arm import (
    Arm,
    Identification,
    effect_from_table,
    read_arm,
)
from traverse.kinematics.effects.arm_effects import effects_from_arm
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.pose import corrected_pose
from traverse.kinematics.model.geometry import geometry_from_arm

RATE_HZ = 10_000.0
SECONDS = sized(4.0, 0.5)
ROUNDS = sized(3, 1)
NOW = datetime.now(tz=UTC)
BEFORE = NOW - timedelta(hours=1)

FIVE: tuple[dict[str, Any], ...] = (
    {
        "kind": "encoder_eccentricity",
        "joint": "J3",
        "cos_rad": 3e-5,
        "sin_rad": -1e-5,
    },
    {
        "kind": "encoder_harmonic",
        "joint": "J5",
        "order": 2,
        "cos_rad": 1e-5,
        "sin_rad": 1e-5,
    },
    {"kind": "backlash", "joint": "J2", "half_width_rad": 1e-5},
    {"kind": "joint_compliance", "joint": "J2", "compliance_rad_nm": 1e-5},
    {"kind": "thermal_expansion", "expansion_per_c": 1.2e-5},
)
OTHERS: tuple[dict[str, Any], ...] = (
    {
        "kind": "transmission_error",
        "joint": "J2",
        "cycles": 80.5,
        "cos_rad": 1e-5,
        "sin_rad": 1e-5,
    },
    {"kind": "encoder_scale", "joint": "J1", "scale_ppm": 10.0},
    {"kind": "encoder_temperature", "joint": "J1", "rate_rad_c": 1e-6},
    {
        "kind": "encoder_drift",
        "joint": "J4",
        "rate_rad_s": 1e-9,
        "epoch_utc": BEFORE,
    },
    {
        "kind": "count_slip",
        "joint": "J6",
        "at_s": 9.0,
        "step_rad": 1e-5,
        "epoch_utc": BEFORE,
    },
    {"kind": "encoder_latency", "latency_s": 1e-4},
    {"kind": "bearing_compliance", "joint": "J4", "compliance_rad_nm": 1e-5},
    {"kind": "mount_compliance", "compliance_rad_nm": 1e-6},
    {
        "kind": "axis_wobble",
        "joint": "J2",
        "order": 2,
        "cos_rad": [1e-5, 0.0, 0.0],
        "sin_rad": [0.0, 0.0, 1e-5],
    },
    {
        "kind": "axis_runout",
        "joint": "J2",
        "component": "radial",
        "order": 2,
        "cos_mm": [0.005, 0.0, 0.0],
        "sin_mm": [0.0, 0.0, 0.005],
    },
    {"kind": "probe_radius", "radius_error_mm": 0.002},
    {"kind": "probe_lobing", "amplitude_mm": 0.002, "phase_rad": 0.3},
    {"kind": "stylus_bending", "compliance_mm_n": 0.001},
    {"kind": "base_drift", "rate_mm_s": [1e-6, 0.0, 0.0], "epoch_utc": BEFORE},
    {
        "kind": "base_step",
        "at_s": 9.0,
        "step_mm": [0.01, 0.0, 0.0],
        "epoch_utc": BEFORE,
    },
    {
        "kind": "empirical",
        "joint": "J7",
        "covariate": "J7_rad",
        "knots": [-2.0, -1.0, 0.0, 1.0, 2.0],
        "values_rad": [0.0, 1e-5, 0.0, -1e-5, 0.0],
    },
)
SETS = {"none": (), "five": FIVE, "all 20": (*FIVE, *OTHERS)}


def arm_with(tables: tuple[dict[str, Any], ...]) -> Arm:
    arm = read_arm(rig.ARM)
    joints = tuple(j.model_copy(update={"mass_kg": 1.0}) for j in arm.joints)
    changes = {
        "joints": joints,
        "effects": tuple(effect_from_table(table) for table in tables),
        "identification": Identification(date=NOW + timedelta(days=1)),
    }
    return arm.model_copy(update=changes)


def block_of(n_samples: int) -> Block:
    rng = np.random.default_rng(1)
    start_ns = time.time_ns()
    return Block(
        angles_rad=rng.uniform(-2.0, 2.0, (n_samples, 7)),
        speeds_rad_s=rng.normal(size=(n_samples, 7)),
        approaches=np.sign(rng.normal(size=(n_samples, 7))),
        temperature_c=np.full(n_samples, 24.0),
        utc_ns=start_ns + np.arange(n_samples) * 100_000,
    )


def stage(calls_s: dict[str, float]) -> Iterator[str]:
    """Lines on the correction alone, by set of effects and length of the block.

    Args:
        calls_s: filled with seconds a block.
    """
    calls = 50
    for name, tables in SETS.items():
        arm = arm_with(tables)
        geometry, effects = geometry_from_arm(arm), effects_from_arm(arm)
        for n_samples in (20, 200):
            block, taken_s = block_of(n_samples), []
            for _ in range(15):
                begun_s = time.process_time()
                for _ in range(calls):
                    corrected_pose(geometry, effects, block)
                taken_s.append((time.process_time() - begun_s) / calls)
            call_s = statistics.median(taken_s)
            calls_s[f"{name}, {n_samples}"] = call_s
            yield (
                f"effects {name}, blocks of {n_samples}: {call_s * 1e6:.0f} us a "
                f"block, {call_s * RATE_HZ / n_samples:.2%} of a core at 10 kHz"
            )


def streams(
    folder: Path, seconds: float, shares: dict[str, list[float]]
) -> Iterator[str]:
    port = rig.free_port()
    n_samples = round(RATE_HZ * seconds)
    with rig.mosquitto(folder, port), rig.simulator(folder):
        for _ in range(ROUNDS):
            for name, tables in SETS.items():
                with rig.daemon(folder, port, arm=arm_with(tables)) as process:
                    scan, share, _ = asyncio.run(
                        follow_scan(port, RATE_HZ, n_samples, process)
                    )
                shares.setdefault(name, []).append(share)
                yield (
                    f"effects {name}: {scan.samples} samples, {len(scan.gaps)} "
                    f"gaps, {scan.lost} lost, {scan.dropped} dropped; daemon "
                    f"{share:.1%} of a core"
                )
    for name, found_shares in shares.items():
        yield f"effects {name}: median {statistics.median(found_shares):.1%} of a core"


def main(path: Path | None = None, seconds: float = SECONDS) -> None:
    before = load()
    print(before)
    blocks_s: dict[str, float] = {}
    shares: dict[str, list[float]] = {}
    for line in stage(blocks_s):
        print(line, flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for line in streams(Path(folder), seconds, shares):
            print(line, flush=True)
    print(load())
    values = {"load": before, "blocks_s": blocks_s, "shares": shares}
    write_json(path, values)


if __name__ == "__main__":
    run_main(main)
