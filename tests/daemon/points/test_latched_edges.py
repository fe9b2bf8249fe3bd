"""Presses and touches by a board that latches all joints at their edge.

Its clock may be badly known while this computer is busy: when a press was is unknown
then, where it was is not.
"""

from dataclasses import replace

import numpy as np
import pytest

from tests.daemon.arm_harness import IDENTITIES, ArmBench, edge
from tests.daemon.effect_entries import effect
from tests.daemon.two_devices import BEGIN_NS, Reader, base, true_counts
from tests.daemon.values import ARM, arm_model
from traverse.daemon.config.schema import UncertaintySection
from traverse.drivers.base.values import (
    STATUS_TIME_UNCERTAIN,
    DeviceUp,
    StreamStarted,
)

EDGE_NS = BEGIN_NS + 123_456_789
CHANNEL_JOINTS = 1, 2, 0
QUIET_NS, BUSY_NS, LOST_NS = 40_000, 5_000_000, 200_000_000
LATCH_NS = 50_000  # after the edge, at most
LATENCY = effect("encoder_latency", latency_s=2e-4)
NOTHING = UncertaintySection(encoder_rad=0, contact_mm=0, trigger_s=0)


def latched_counts(time_ns):
    counts = np.rint(true_counts(np.array([time_ns]))).astype(np.int64)[0]
    moduli = IDENTITIES["base"].moduli_counts
    return tuple(
        int(counts[joint]) % modulus
        for joint, modulus in zip(CHANNEL_JOINTS, moduli, strict=True)
    )


def point_of(
    folder,
    time_bound_ns,
    *,
    text=ARM,
    counts_ns=EDGE_NS,
    jitter_ns=LATCH_NS,
    **identity,
):
    """The point of an edge, in readings until after it."""
    bench = ArmBench(folder, arm_model(folder, text), uncertainty=NOTHING)
    board = replace(IDENTITIES["base"], jitter_ns=jitter_ns, **identity)
    bench.take(DeviceUp("base", board, False), StreamStarted("base", 1, 100.0))
    whole: Reader = base(channels=CHANNEL_JOINTS)
    bench.take(whole.samples(range(14)))
    counts = latched_counts(counts_ns)
    bench.take(edge("base", EDGE_NS, counts=counts, time_bound_ns=time_bound_ns))
    (point,) = bench.points
    bench.close()
    return point


def std_mm(point):
    xx, _, _, yy, _, zz = point.covariance_mm2
    return np.sqrt(xx + yy + zz)


async def test_its_place_is_as_certain_on_a_busy_computer_as_on_a_quiet_one(tmp_path):
    quiet, busy = (point_of(tmp_path, ns) for ns in (QUIET_NS, BUSY_NS))
    assert busy.quality.ok
    assert busy.covariance_mm2 == quiet.covariance_mm2
    # Beside the rounding: what the board itself leaves between edge and counts.
    later = point_of(tmp_path, QUIET_NS, counts_ns=EDGE_NS + 1_000_000)
    way_mm = np.linalg.norm(np.subtract(later.xyz_mm, busy.xyz_mm)) * LATCH_NS * 1e-6
    rounding_mm = std_mm(point_of(tmp_path, BUSY_NS, jitter_ns=0))
    assert way_mm > 0.005
    expected_mm = np.hypot(rounding_mm, way_mm / np.sqrt(3.0))
    assert std_mm(busy) == pytest.approx(expected_mm, rel=0.02)


async def test_a_time_that_is_lost_is_flagged_and_the_place_has_its_uncertainty(
    tmp_path,
):
    lost = point_of(tmp_path, LOST_NS)
    assert lost.quality.flags == ("time_uncertain",)
    assert lost.covariance_mm2 == point_of(tmp_path, QUIET_NS).covariance_mm2


async def test_counts_of_the_line_that_shows_a_press_are_of_that_line_time(tmp_path):
    """They are of no edge: its time may be off, and the ball was elsewhere then."""
    quiet, busy = (
        std_mm(point_of(tmp_path, ns, latches=False)) for ns in (QUIET_NS, BUSY_NS)
    )
    assert busy > 20.0 * quiet


async def test_effects_by_the_speed_depend_on_the_clock(tmp_path):
    quiet, busy = (
        std_mm(point_of(tmp_path, ns, text=ARM + LATENCY)) for ns in (QUIET_NS, BUSY_NS)
    )
    assert busy > 20.0 * quiet


@pytest.mark.parametrize("time_bound_ns", [QUIET_NS, BUSY_NS, 40_000_000])
async def test_counts_of_another_instant_are_denied_however_busy_the_computer_is(
    tmp_path, time_bound_ns
):
    """Readings and edge have one counter, and are compared by that."""
    early = point_of(tmp_path, time_bound_ns, counts_ns=EDGE_NS - 25_000_000)
    assert early.quality.flags == ("time_uncertain",)
    assert point_of(tmp_path, time_bound_ns).quality.ok


@pytest.mark.parametrize(
    ("status", "bound_ns", "step_s", "is_the_boards"),
    [(0, QUIET_NS, 3600, False), (STATUS_TIME_UNCERTAIN, 1_000_000_000, 0, True)],
)
async def test_the_board_is_named_where_its_time_is_in_doubt_not_where_utc_was_set(
    tmp_path, status, bound_ns, step_s, is_the_boards
):
    bench = ArmBench(tmp_path, arm_model(tmp_path, ARM), uncertainty=NOTHING)
    board = replace(IDENTITIES["base"], jitter_ns=LATCH_NS)
    bench.take(DeviceUp("base", board, False), StreamStarted("base", 1, 100.0))
    whole: Reader = base(channels=CHANNEL_JOINTS)
    bench.take(whole.samples(range(14)))
    bench.clock.offset_ns += step_s * 10**9
    counts = latched_counts(EDGE_NS)
    press = edge("base", EDGE_NS, counts=counts, time_bound_ns=bound_ns)
    bench.take(replace(press, status=(status,) * len(counts)))
    bench.close()
    (point,) = bench.points
    assert "time_uncertain" in point.quality.flags
    assert ("condition.device_clock" in bench.codes()) == is_the_boards
