"""Driver and simulated line together: what is believed was true when it was read."""

import numpy as np
import pytest

from benchmarks.drivers.moving_arm import Case, moving, read_virtually
from traverse.drivers.base.values import (
    STATUS_MISSING,
    CountSamples,
    DeviceAlarm,
    DeviceFault,
    DeviceLost,
)

CASE = Case(0.0005, 0.0002, 100.0, sway_hz=0.5)
SECONDS = 4.0
TURN = 16384
SILENT = {"kind": "silent", "channel": 3, "at_s": 1.0, "duration_s": 1.0}
RESET = {"kind": "reset", "channel": 5, "at_s": 2.0, "duration_s": 0.2}


def line_fault(kind, probability=0.01, **more):
    return {"kind": kind, "probability": probability, **more}


@pytest.mark.parametrize(
    "faults",
    [
        (),
        (line_fault("lost"),),
        (line_fault("corrupted", 0.02),),
        (line_fault("check", 0.02),),
        (line_fault("garbage", 0.005),),
        (line_fault("repeated"),),
        (line_fault("late", delay_s=0.004), line_fault("late", delay_s=0.012)),
        (SILENT, RESET),
    ],
    ids=lambda faults: " ".join(fault["kind"] for fault in faults) or "good",
)
def test_what_is_believed_was_true_when_it_was_read(tmp_path, faults):
    arm = moving(tmp_path, CASE, SECONDS, faults)
    told, first_ns = read_virtually(arm, CASE, SECONDS)
    blocks = [one for one in told if isinstance(one, CountSamples)]
    counts = np.concatenate([b.counts for b in blocks]).astype(np.int64)
    missing = np.concatenate([b.status for b in blocks]) & STATUS_MISSING != 0
    seq = np.concatenate([b.seq for b in blocks])
    instants_ns = np.concatenate([b.sample_time_ns for b in blocks])
    skews_ns = np.concatenate([b.skew_ns for b in blocks if b.skew_ns is not None])
    assert missing.mean() < (0.08 if faults else 1e-9)
    for channel in range(7):
        read_s = (instants_ns + skews_ns[:, channel] - first_ns) * 1e-9
        readings_rad = arm.course.readings_rad(read_s)
        true = arm.mounting.encoders.counts(readings_rad, np.random.default_rng(0))
        off = (counts[:, channel] - true[:, channel] + TURN // 2) % TURN - TURN // 2
        good = ~missing[:, channel]
        # At 1 rad/s half of 5 ms, the longest exchange that is believed, is 7 counts.
        assert np.abs(off[good]).max() <= 7
        assert good.any()
    lost = [f for f in told if isinstance(f, DeviceFault) and f.code == "samples_lost"]
    assert seq[-1] + 1 - len(seq) == sum(fault.count for fault in lost)
    assert not any(isinstance(one, DeviceLost) for one in told)
    alarms = [one.channel for one in told if isinstance(one, DeviceAlarm)]
    assert set(alarms) <= ({3, 5} if faults == (SILENT, RESET) else set())
