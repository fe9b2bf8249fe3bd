"""`python -m benchmarks.service.hostile`: the daemon beside a hostile client.

The same daemon throughout: points by command one after the other; then, while a scan
runs and a client floods the commands as fast as the broker takes them, how late blocks
of the scan are (commands are dropped then); then points by command again. Medians, and
the flood's cost to the daemon.
"""

import contextlib
import statistics
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import msgpack

from benchmarks.tools import rig
from benchmarks.tools.command_line import run_main
from benchmarks.tools.presses import ARM
from benchmarks.tools.raw_mqtt import PUBLISH, RawClient, packet, text
from benchmarks.tools.rounds import load
from benchmarks.tools.sizes import sized
from traverse.protocol.encoding import decode, encode
from traverse.protocol.messages import Command, PointArgs, Scan, ScanArgs
from traverse.protocol.topics import command_topic

POINTS = sized(200, 5)
PACE_S = 0.025  # below the limit of 50 points a second
FLOOD_S = sized(15.0, 1.0)
SCAN_HZ = 200.0
TOPIC = command_topic(ARM, "point")


def begin_scan(port: int, rate_hz: float) -> None:
    """Have the daemon stream; returns when it does."""
    client = RawClient(port, "scan-starter")
    client.subscribe(f"traverse/{ARM}/health")
    client.subscribe(f"traverse/{ARM}/scan")
    args = ScanArgs(action="start", rate_hz=rate_hz)
    command = Command.carrying(args, request="latency")
    for _, payload in client.payloads():
        if "dtime_ns" in msgpack.unpackb(payload):
            break
        # A status proves that it is subscribed; the first may be the previous daemon's.
        client.publish(command_topic(ARM, "scan"), 1, encode(command, "json"))
    client.close()


def by_command_ms(port: int, name: str, n: int = POINTS) -> list[float]:
    """Measure from sending a command to its answer [ms]."""
    client = RawClient(port, name)
    client.subscribe(f"traverse/{ARM}/reply/point")
    answers = client.payloads()
    taken_ms = []
    for k in range(n):
        command = encode(Command.carrying(PointArgs(), f"{name}-{k}"), "msgpack")
        begun_ns = time.monotonic_ns()
        client.publish(TOPIC, k, command)
        for now_ns, payload in answers:
            answer = msgpack.unpackb(payload)
            if answer["request"] == f"{name}-{k}":
                if not answer["ok"]:
                    raise RuntimeError(f"refused: {answer['error']}")
                taken_ms.append((now_ns - begun_ns) * 1e-6)
                break
        time.sleep(PACE_S)
    client.close()
    return taken_ms


@contextlib.contextmanager
def flood(port: int) -> Iterator[list[int]]:
    sent, ended = [0], threading.Event()
    payload = encode(Command.carrying(PointArgs(), "flood"), "msgpack")
    burst = packet(PUBLISH, 0, text(TOPIC) + payload) * 100

    def send() -> None:
        client = RawClient(port, "flood")
        while not ended.is_set():
            client._socket.sendall(burst)  # noqa: SLF001 - of our own
            sent[0] += 100
        client.close()

    thread = threading.Thread(target=send)
    thread.start()
    try:
        yield sent
    finally:
        ended.set()
        thread.join()


def blocks_ms(port: int, seconds: float, name: str) -> list[float]:
    """Measure from a block's last sample to a subscriber that has decoded it [ms]."""
    client = RawClient(port, name)
    client.subscribe(f"traverse/{ARM}/scan")
    end_s = time.monotonic() + seconds
    late_ms = []
    for _, payload in client.payloads():
        scan = decode(Scan, payload)
        last_ns = scan.time_ns + int(scan.dtime_ns[-1])
        late_ms.append((time.time_ns() - last_ns) * 1e-6)
        if time.monotonic() > end_s:
            break
    client.close()
    return late_ms


def figures_line(name: str, values_ms: list[float]) -> str:
    ordered = sorted(values_ms)
    p99 = ordered[int(0.99 * (len(ordered) - 1))]
    return (
        f"{name:38} n {len(ordered):4}  p50 {statistics.median(ordered):6.2f} ms  "
        f"p99 {p99:6.2f} ms"
    )


def main() -> None:
    print(load())
    port = rig.free_port()
    with (
        tempfile.TemporaryDirectory() as name,
        rig.mosquitto(Path(name), port),
        rig.simulator(Path(name)),
        rig.daemon(Path(name), port) as daemon,
    ):
        time.sleep(3.0)
        before_mb = rig.rss_mb(daemon)
        print(figures_line("a point by command, before", by_command_ms(port, "before")))
        begin_scan(port, SCAN_HZ)
        cpu_s, begun_s = rig.cpu_s(daemon), time.monotonic()
        print(figures_line("a block of a scan", blocks_ms(port, FLOOD_S, "quiet")))
        share = (rig.cpu_s(daemon) - cpu_s) / (time.monotonic() - begun_s)
        print(f"the daemon meanwhile: {share:.0%} of a core")
        cpu_s, begun_s = rig.cpu_s(daemon), time.monotonic()
        with flood(port) as sent:
            flooded = blocks_ms(port, FLOOD_S, "flooded")
        share = (rig.cpu_s(daemon) - cpu_s) / (time.monotonic() - begun_s)
        rate_hz = sent[0] / FLOOD_S
        print(figures_line(f"the same, flooded by {rate_hz:.0f} commands/s", flooded))
        print(f"the daemon meanwhile: {share:.0%} of a core")
        time.sleep(6.0)  # until commands are accepted again
        print(figures_line("a point by command, after", by_command_ms(port, "after")))
        print(f"memory: {before_mb:.0f} MB before, {rig.rss_mb(daemon):.0f} MB after")


if __name__ == "__main__":
    run_main(main)
