"""A timed stream over a pty to an MQTT subscriber: completeness and cost."""

import asyncio
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.tools import rig
from traverse.broker.address import BrokerAddress
from traverse.client.mqtt.connection import ConfiguredClient
from traverse.client.mqtt.subscription import received, subscribe
from traverse.protocol.encoding import encode
from traverse.protocol.messages import Command, Event, Health, Scan, ScanArgs, Status
from traverse.protocol.topics import command_topic

ARM = "demo-7"


@dataclass
class Followed:
    """One scan as a subscriber received it."""

    samples: int = 0
    expected_seq: int = 0
    gaps: list[tuple[int, int]] = field(default_factory=list)
    repeated_blocks: int = 0
    first_ns: int = 0
    last_ns: int = 0
    lost: int = 0
    dropped: int = 0
    events: list[str] = field(default_factory=list)
    health: Health | None = None

    def add(self, scan: Scan) -> None:
        n = len(scan.dtime_ns)
        if not n:
            return
        if scan.seq < self.expected_seq:
            self.repeated_blocks += 1
            return
        if scan.seq > self.expected_seq:
            self.gaps.append((self.expected_seq, scan.seq))
        self.expected_seq = scan.seq + n
        self.samples += n
        self.first_ns = self.first_ns or scan.time_ns
        self.last_ns = scan.time_ns + int(scan.dtime_ns[-1])
        self.lost, self.dropped = scan.lost, scan.dropped


async def order_scan(client: ConfiguredClient, action: str, rate_hz: float) -> None:
    args = ScanArgs(action="start", rate_hz=rate_hz)
    if action == "stop":
        args = ScanArgs(action="stop")
    command = Command.carrying(args, request=f"{action}-{time.monotonic_ns()}")
    await client.publish(command_topic(ARM, "scan"), encode(command, "msgpack"), qos=1)


async def wait_until_subscribed(port: int) -> None:
    """Wait for the daemon's first status, after which it takes commands."""
    async with ConfiguredClient(BrokerAddress("127.0.0.1", port)) as client:
        await subscribe(client, ARM, ("status",))
        async for item in received(client):
            if isinstance(item.message, Status) and item.message.online:
                return


async def follow_scan(
    port: int, rate_hz: float, n_samples: int, process: "subprocess.Popen[bytes]"
) -> tuple[Followed, float, float]:
    """Scan until ``n_samples`` instants have passed.

    Returns:
        The received part, the daemon's CPU share of one core, and its seconds.
    """
    followed = Followed()
    async with ConfiguredClient(BrokerAddress("127.0.0.1", port)) as client:
        await subscribe(client, ARM, ("scan", "event", "health"))
        begun_s, begun_cpu_s = 0.0, 0.0
        async for item in received(client):
            message = item.message
            if isinstance(message, Scan):
                if not begun_s:
                    begun_s, begun_cpu_s = time.monotonic(), rig.cpu_s(process)
                followed.add(message)
                if followed.expected_seq >= n_samples:
                    break
            elif isinstance(message, Health):
                followed.health = message
                # A status proves that it is subscribed; the first may be the broker's
                # retained one of the previous daemon.
                if not begun_s:
                    await order_scan(client, "start", rate_hz)
            elif isinstance(message, Event):
                followed.events.append(f"{message.code}: {message.text}")
        taken_s = time.monotonic() - begun_s
        share = (rig.cpu_s(process) - begun_cpu_s) / taken_s
        await order_scan(client, "stop", rate_hz)
    return followed, share, taken_s


@dataclass(frozen=True, slots=True)
class Streamed:
    """A stream and its cost; shares are of one core.

    Attributes:
        ready_s: from starting the daemon to its report that it measures.
    """

    rate_hz: float
    seconds: float
    samples: int
    gaps: int
    lost: int
    dropped: int
    achieved_hz: float
    daemon_share: float
    simulator_share: float
    memory_mb: float
    ready_s: float
    start_cpu_s: float

    def line(self) -> str:
        return (
            f"{self.rate_hz:6.0f} Hz for {self.seconds:g} s: {self.samples} samples, "
            f"{self.gaps} gaps, {self.lost} lost on the line, {self.dropped} dropped, "
            f"{self.achieved_hz:.1f} Hz achieved; daemon {self.daemon_share:.1%} of a "
            f"core, {self.memory_mb:.0f} MB, ready after {self.ready_s:.2f} s; "
            f"simulator {self.simulator_share:.1%}"
        )


def stream(folder: Path, rate_hz: float, seconds: float) -> Streamed:
    port = rig.free_port()
    n_samples = round(rate_hz * seconds)
    with rig.mosquitto(folder, port), rig.simulator(folder) as board:
        begun_s = time.monotonic()
        with rig.daemon(folder, port) as process:
            ready_s = time.monotonic() - begun_s
            start_cpu_s = rig.cpu_s(process)
            begun = rig.cpu_s(board)
            followed, share, taken_s = asyncio.run(
                follow_scan(port, rate_hz, n_samples, process)
            )
            board_share = (rig.cpu_s(board) - begun) / taken_s
            memory_mb = rig.rss_mb(process)
    spanned_ns = followed.last_ns - followed.first_ns
    return Streamed(
        rate_hz,
        seconds,
        followed.samples,
        len(followed.gaps),
        followed.lost,
        followed.dropped,
        (followed.samples - 1) / spanned_ns * 1e9,
        share,
        board_share,
        memory_mb,
        ready_s,
        start_cpu_s,
    )
