"""`python -m benchmarks.service.recording [FILE] [SECONDS]`: cost of a recording.

One daemon with a stream of 10 kHz, with a recording and without in turn, so that other
load falls on both; the same with the flight recorder. Then the recording is replayed.
"""

import asyncio
import logging
import statistics
import subprocess
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.service.stream import ARM, order_scan
from benchmarks.tools import rig
from benchmarks.tools.command_line import run_main
from benchmarks.tools.rounds import load, write_json
from benchmarks.tools.sizes import sized
from traverse.broker.address import BrokerAddress
from traverse.client.mqtt.connection import ConfiguredClient
from traverse.client.mqtt.subscription import received, subscribe
from traverse.daemon.replay.compare import ReplayResult
from traverse.daemon.replay.replay import Replay
from traverse.protocol.encoding import encode
from traverse.protocol.messages import Command, Health, RecordArgs, Reply
from traverse.protocol.topics import command_topic
from traverse.recording.run_reader import RunReader

RATE_HZ = 10_000.0
ROUNDS = sized(4, 2)
SECONDS = sized(8.0, 1.0)
SETTLE_S = 1.0
NOISE = "noise_rad = 4e-6"  # as of real encoders: noise is what takes room


@dataclass(frozen=True, slots=True)
class Cost:
    """Measured cost; shares are of one core.

    Attributes:
        without, with_it: of the daemon, medians of the rounds, a scan published in all.
        bytes_per_sample: of the file, the scan's points in it included.
        flight: the same share of a daemon with the flight recorder, nothing else.
        flight_bytes_per_sample: of its segments, without the scan's points.
        queued: items that waited at most.
        replay_samples_s: replayed in blocks as they were, and in blocks of 1000.
    """

    without: float
    with_it: float
    bytes_per_sample: float
    flight: float
    flight_bytes_per_sample: float
    queued: int
    dropped: int
    gaps: int
    replay_samples_s: tuple[float, float]
    points_of_scans: int
    same: int


class Meter:
    """A subscriber that measures the daemon's share and requests a recording."""

    def __init__(
        self, client: ConfiguredClient, process: "subprocess.Popen[bytes]"
    ) -> None:
        self._client = client
        self._process = process
        self._replies: asyncio.Queue[Reply] = asyncio.Queue()
        self.queued = self.dropped = 0

    async def listen(self) -> None:
        async for item in received(self._client):
            if isinstance(item.message, Reply):
                self._replies.put_nowait(item.message)
            elif isinstance(item.message, Health):
                self.queued = max(self.queued, item.message.recording.queued)
                self.dropped = item.message.recording.dropped

    async def record(self, args: RecordArgs) -> dict[str, Any]:
        command = Command.carrying(args, str(time.monotonic_ns()))
        topic = command_topic(ARM, "record")
        await self._client.publish(topic, encode(command, "msgpack"), qos=1)
        while True:
            reply = await asyncio.wait_for(self._replies.get(), 10)
            if reply.request == command.request:
                if not reply.ok:
                    raise RuntimeError(str(reply.error))
                return dict(reply.result or {})

    async def share(self, seconds: float) -> float:
        await asyncio.sleep(SETTLE_S)
        begun_s, begun_cpu_s = time.monotonic(), rig.cpu_s(self._process)
        await asyncio.sleep(seconds)
        used_s = rig.cpu_s(self._process) - begun_cpu_s
        return used_s / (time.monotonic() - begun_s)


async def measured(
    port: int, process: "subprocess.Popen[bytes]", seconds: float, rounds: int
) -> tuple[list[float], list[float], list[dict[str, Any]], Meter]:
    """Return shares without and with a recording, in turn, and the recordings."""
    async with ConfiguredClient(BrokerAddress("127.0.0.1", port)) as client:
        await subscribe(client, ARM, ("reply", "health"))
        meter = Meter(client, process)
        listening = asyncio.create_task(meter.listen())
        without, with_it, recorded = [], [], []
        for number in range(rounds):
            await asyncio.sleep(SETTLE_S)
            await order_scan(client, "start", RATE_HZ)
            without.append(await meter.share(seconds))
            if rounds > 1:
                await meter.record(RecordArgs(action="start", name=f"r{number}"))
                # A scan that begins in the recording can be compared.
                await order_scan(client, "start", RATE_HZ)
                with_it.append(await meter.share(seconds))
                recorded.append(await meter.record(RecordArgs(action="stop")))
        await order_scan(client, "stop", RATE_HZ)
        await asyncio.sleep(0.5)
        listening.cancel()
    return without, with_it, recorded, meter


def cost(seconds: float) -> Cost:
    with tempfile.TemporaryDirectory() as name:
        folder, port = Path(name), rig.free_port()
        off = "[recording]\nflight = false\nmin_free_mb = 10\n"
        with (
            rig.mosquitto(folder, port),
            rig.simulator(folder, arm=NOISE),
            rig.daemon(folder, port, off) as process,
        ):
            without, with_it, recorded, meter = asyncio.run(
                measured(port, process, seconds, ROUNDS)
            )
        file = Path(recorded[-1]["file"])
        as_they_were, result = replayed(file, None)
        in_thousands, _ = replayed(file, 1000)
        size = file.stat().st_size
    with tempfile.TemporaryDirectory() as name:
        folder, port = Path(name), rig.free_port()
        on = "[recording]\nmin_free_mb = 10\n"
        with (
            rig.mosquitto(folder, port),
            rig.simulator(folder, arm=NOISE),
            rig.daemon(folder, port, on) as process,
        ):
            flight, _, _, _ = asyncio.run(measured(port, process, 2 * seconds, 1))
        segments = sorted((folder / "state/recordings/flight").glob("*.mcap"))
        flown = [(s.stat().st_size, replayed(s, None)[1].samples) for s in segments]
    largest = max(flown, key=lambda item: item[1])
    return Cost(
        statistics.median(without),
        statistics.median(with_it),
        size / result.samples,
        statistics.median(flight),
        largest[0] / largest[1],
        meter.queued,
        meter.dropped,
        sum(recorded_file["gaps"] for recorded_file in recorded),
        (as_they_were, in_thousands),
        result.scans.tally.n,
        result.scans.tally.same,
    )


def replayed(file: Path, block: int | None) -> tuple[float, ReplayResult]:
    async def replay() -> ReplayResult:
        with RunReader(file) as reader:
            return Replay(reader, block).run()

    begun_s = time.perf_counter()
    result = asyncio.run(replay())
    return result.samples / (time.perf_counter() - begun_s), result


def main(file: Path | None = None, seconds: float = SECONDS) -> None:
    before = load()
    logging.getLogger("traverse.daemon").setLevel(logging.CRITICAL)  # of the past
    print(before)
    costs = cost(seconds)
    print(
        f"{RATE_HZ:.0f} Hz, scan published: daemon {costs.without:.1%} of a core "
        f"without a recording, {costs.with_it:.1%} with one, flight recorder alone "
        f"{costs.flight:.1%}\n"
        f"file {costs.bytes_per_sample:.1f} bytes per sample with the "
        f"scan's points, flight recorder {costs.flight_bytes_per_sample:.1f}\n"
        f"at most {costs.queued} items waiting, {costs.dropped} dropped, "
        f"{costs.gaps} gaps\n"
        f"replay {costs.replay_samples_s[0]:.0f} samples/s in blocks as they were, "
        f"{costs.replay_samples_s[1]:.0f} in blocks of 1000; {costs.same} of "
        f"{costs.points_of_scans} points of the scan the same to the last bit"
    )
    print(load())
    write_json(file, {"load": before, **asdict(costs)})


if __name__ == "__main__":
    run_main(main)
