"""`python -m benchmarks.service.life`: what running as a service costs.

Time from the start of the program to READY=1, time from a stuck reader thread to the
moment in which systemd would act, and what the histograms of latencies cost.
"""

import contextlib
import os
import signal
import socket
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks.tools import rig
from tests.end_to_end.service.service_manager import stopped_thread
from tests.protocol.message_examples import HEALTH
from traverse.daemon.monitoring.latencies import Latencies
from traverse.daemon.monitoring.prometheus import exposition

STARTS = 7
WATCHDOG_S = 10.0  # as in the unit in deploy/
LONGEST_S = 60.0


@contextlib.contextmanager
def manager(folder: Path) -> Iterator[socket.socket]:
    """The socket that services started meanwhile notify."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as heard:
        heard.bind(str(folder / "notify"))
        heard.settimeout(LONGEST_S)
        os.environ["NOTIFY_SOCKET"] = str(folder / "notify")
        os.environ["WATCHDOG_USEC"] = str(int(WATCHDOG_S * 1e6))
        yield heard


def wait_for(heard: socket.socket, line: bytes) -> float:
    """Monotonic time at which a line arrives."""
    while True:
        if line in heard.recv(65536).split(b"\n"):
            return time.monotonic()


def starts_s(folder: Path, port: int, heard: socket.socket) -> list[float]:
    """Times from the start of the program to READY=1."""
    times = []
    for _ in range(STARTS):
        begun_s = time.monotonic()
        with rig.daemon(folder, port):
            times.append(wait_for(heard, b"READY=1") - begun_s)
        heard.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while heard.recv(65536):
                pass
        heard.settimeout(LONGEST_S)
    return times


def reaction_s(folder: Path, port: int, heard: socket.socket) -> tuple[float, float]:
    """From the stop of a reader thread to the last feeding, and to systemd's act."""
    with rig.daemon(folder, port) as process:
        wait_for(heard, b"READY=1")
        wait_for(heard, b"WATCHDOG=1")
        with stopped_thread(process.pid, "driver-base"):
            stopped_s = fed_s = time.monotonic()
            while True:
                heard.settimeout(max(0.001, fed_s + WATCHDOG_S - time.monotonic()))
                try:
                    fed_s = wait_for(heard, b"WATCHDOG=1")
                except TimeoutError:
                    break
            acted_s = time.monotonic()
            process.send_signal(signal.SIGABRT)
        process.wait()
    return fed_s - stopped_s, acted_s - stopped_s


def costs_us() -> tuple[float, float]:
    """Of a latency, of the figures for one scrape."""
    latencies = Latencies()

    def cost_us(n: int, act: Callable[[], object]) -> float:
        begun_s = time.process_time()
        for _ in range(n):
            act()
        return (time.process_time() - begun_s) / n * 1e6

    return (
        cost_us(100_000, lambda: latencies.add(123_456)),
        cost_us(500, lambda: exposition(HEALTH, {"x": latencies}, 1.0, "0.1")),
    )


def main() -> None:
    """Measure and print."""
    latency_us, scrape_us = costs_us()
    print(f"a latency {latency_us:.2f} us")
    print(f"figures for one scrape {scrape_us:.0f} us")
    with tempfile.TemporaryDirectory() as name, manager(Path(name)) as heard:
        folder, port = Path(name), rig.free_port()
        with rig.mosquitto(folder, port), rig.simulator(folder):
            times = starts_s(folder, port, heard)
            print(
                f"READY after {statistics.median(times):.2f} s (median of {STARTS}), "
                f"at most {max(times):.2f} s"
            )
            fed_s, acted_s = reaction_s(folder, port, heard)
            print(
                f"a stuck reader: last feeding after {fed_s:.1f} s, systemd acts after "
                f"{acted_s:.1f} s (WatchdogSec={WATCHDOG_S:g})"
            )
    load = ", ".join(f"{one:.1f}" for one in os.getloadavg())
    print(f"load {load} on {os.cpu_count()} processors")


if __name__ == "__main__":
    main()
