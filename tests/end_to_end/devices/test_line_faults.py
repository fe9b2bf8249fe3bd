from typing import Any

import numpy as np
import pytest

from tests.end_to_end.agreement import assert_one_point_an_edge
from tests.end_to_end.listener import Listener, numbers
from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import REST, SPHERE, Workbench
from traverse.protocol.messages import QualityFlag
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")
N_POINTS = 4


def line_fault(kind: str, probability: float = 0.05) -> str:
    return f'[[fault]]\nkind = "{kind}"\nprobability = {probability}\n'


async def scan_and_probe(
    bench: Workbench, faults: str
) -> tuple[Listener, np.ndarray, dict[str, Any]]:
    """Scan at 1 kHz while points are taken.

    Returns:
        The listener, the scan's numbers, and the simulator's summary of the device.
    """
    # Held by hand: without noise it would stand still as no arm does.
    noise = "noise_rad = 5e-6"
    bench.write_simulator(SPHERE.format(points=N_POINTS), arm=noise, faults=faults)
    bench.write_daemon()
    async with measuring(bench) as (listener, simulator, _):
        scan = await listener.start_scan(1000.0)
        await listener.n_points(N_POINTS)
        await listener.scan_points(scan, 1600)
        blocks = await listener.stop_scan(scan)
        assert await simulator.stop() == 0
        await listener.event("device.lost", active=True)
        n_healths = len(listener.healths)
        await until(lambda: len(listener.healths) > n_healths + 1, "last figures")
    seq = numbers(blocks)
    assert (np.diff(seq) > 0).all()  # in order, none twice
    missing = (blocks[-1].total or 0) - len(seq)
    assert blocks[-1].lost == missing
    assert_one_point_an_edge(bench, listener.points, bench.presses())
    return listener, seq, bench.truth()[-1]["base"]


async def test_a_healthy_line_loses_and_reports_nothing(bench: Workbench) -> None:
    listener, seq, outcome = await scan_and_probe(bench, "")
    assert (np.diff(seq) == 1).all()
    counters = listener.healths[-1].counters
    assert (counters["samples_lost"], counters["frames_rejected"]) == (0, 0)
    assert (
        counters["edges_lost"] == outcome["tx_dropped"] == outcome["rx_rejected"] == 0
    )
    expected = {"button.pressed", "button.released", "device.lost", "broker.lost"}
    # A busy machine reads late, and says that it does not know the board's clock.
    expected.add("condition.device_clock")
    assert {e.code for e in listener.events} <= expected


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["corrupted", "garbage", "repeated"])
async def test_only_touched_samples_are_missing_and_no_edge(
    bench: Workbench, kind: str
) -> None:
    listener, seq, outcome = await scan_and_probe(bench, line_fault(kind))
    faults = outcome["faults"][kind]
    missing = int(np.sum(np.diff(seq) - 1))
    counters = listener.healths[-1].counters
    assert faults > 30
    if kind != "repeated":
        # Garbage spoils the frame behind it; a struck delimiter spoils two frames.
        touched = faults * (2 if kind == "corrupted" else 1)
        assert 0 < missing <= touched
        assert 0 < counters["samples_lost"] <= touched
    else:
        assert missing == counters["samples_lost"] == counters["frames_rejected"] == 0
        assert listener.healths[-1].devices[0].counters["samples_repeated"] > 0
    if kind in {"corrupted", "garbage"}:
        assert 0 < counters["frames_rejected"] <= 2 * faults
        assert listener.events_of("device.frames_rejected")
    assert counters["edges_lost"] == 0


@pytest.mark.slow
async def test_an_encoder_that_doubts_its_count_marks_points_and_samples(
    bench: Workbench,
) -> None:
    # Not before the scan has begun, on a busy machine either.
    fault = '[[fault]]\nkind = "status"\nchannel = 2\nat_s = 3.5\nduration_s = 1.5\n'
    bench.write_simulator(REST, faults=fault)
    bench.write_daemon()
    async with measuring(bench) as (listener, _, _):
        scan = await listener.start_scan(200.0)
        raised = await listener.event("alarm.2", active=True)
        cleared = await listener.event("alarm.2", active=False)
        blocks = await listener.stop_scan(scan)
    assert raised.source == cleared.source == "base/2"
    quality = np.concatenate([b.quality for b in blocks])
    # A busy machine reads late, and says that it does not know the board's clock.
    quality &= ~np.uint32(QualityFlag.TIME_UNCERTAIN)
    # The device's alarm is a warning on top of what each sample says of itself.
    # The first one after it has none before it of which its speed would follow.
    begins = int(QualityFlag.MOTION_UNKNOWN)
    assert set(quality.tolist()) <= {0, 1, 2, 3, begins}
    assert np.sum(quality == begins) <= 1
    doubted = np.flatnonzero(quality & 1)
    assert len(doubted) == pytest.approx(300, abs=2)
    assert (np.diff(doubted) == 1).all()
