import numpy as np
import pytest

from tests.daemon.board_harness import BOARD
from tests.daemon.values import count_samples, latch
from tests.protocol.message_examples import HEALTH
from traverse.drivers.base.values import (
    DeviceCounters,
    DeviceFault,
    DeviceTemperatures,
    DeviceUp,
)
from traverse.protocol.encoding import decode, encode
from traverse.protocol.messages import Health
from traverse.protocol.messages.health import LATENCIES


async def test_health_tells_figures_and_takes_them_anew_each_time(bench):
    bench.take(
        DeviceUp("base", BOARD, False),
        DeviceCounters("base", {"samples_received": 200, "samples_lost": 3}),
        DeviceTemperatures("base", (None, 21.5)),
        DeviceFault("base", "samples_lost", "3 lost", "faster line", 3),
    )
    samples = count_samples(np.zeros((4, 3)))
    bench.clock.now_ns = samples.received_ns + 250_000
    bench.take(samples, latch((1, 2, 3), now_ns=bench.clock.now_ns - 40_000))
    bench.clock.now_ns = 10**12 + 2 * 10**9
    first = health(bench)
    assert first.counters["samples_received"] == 200
    assert first.counters["samples_lost"] == 3
    assert first.counters["points_captured"] == 1
    assert first.rates_hz["samples_received"] == pytest.approx(100.0)
    assert first.uptime_s == pytest.approx(2.0)
    assert first.temperatures_c == {"arm": 21.5}
    assert first.latencies["queue_wait"].max_us == 250.0
    assert first.latencies["capture_to_publish"].p50_us == 40.0
    assert set(first.latencies) <= set(LATENCIES)
    (device,) = first.devices
    assert device.rate_hz == pytest.approx(2.0)
    assert device.temperatures_c == {"1": 21.5}
    assert device.age_s == pytest.approx(2 - 0.03125)  # since the last of them
    assert first.rss_bytes > 1_000_000
    bench.clock.now_ns += 10**9
    second = health(bench)
    assert second.latencies == {}
    assert second.rates_hz["samples_received"] == 0.0
    assert second.counters["samples_received"] == 200
    assert decode(Health, encode(second, "msgpack")) == second


def health(bench) -> Health:
    return bench.health.message(
        bench.measurement,
        broker=HEALTH.broker,
        outbox=HEALTH.outbox,
        spool=None,
        recording=HEALTH.recording,
        counters={"points_captured": len(bench.points)},
    )
