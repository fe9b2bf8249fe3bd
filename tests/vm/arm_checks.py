"""A whole arm on vcan0: simulator, broker, daemon, as programs of their own."""

import contextlib
import json
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests import programs
from tests.end_to_end.arm_matrices import MatrixArm
from tests.end_to_end.listener import Listener, listening
from tests.end_to_end.programs import Program
from tests.end_to_end.workbench import Workbench
from tests.mosquitto import Mosquitto
from tests.vm import can_interface
from tests.vm.bus_checks import NODES
from tests.vm.can_arm import N_POINTS, TRACKING_HZ, write_files
from tests.vm.can_interface import NAME, open_raw, send
from tests.vm.progress import until_heard
from tests.vm.table import Table
from traverse.protocol.canopen.frames import HEARTBEAT, identifiers
from traverse.protocol.messages import Event, Point, PointArgs

MEASURING = ("ready", "doubt")  # with all devices; the arm is not identified
START_S = 120.0
SOON_S = 40.0
HEALTHS = 120  # messages, one a second of the daemon's
ERROR_FRAME, BUS_OFF, RESTARTED = 0x2000_0000, 0x40, 0x100
FLOOD = 20_000
STEADY = 200  # samples
MOST_TOUCHES = 8  # to take the points at
TRIES = 5


class ArmOnBus:
    def __init__(self, bench: Workbench, listener: Listener, daemon: Program) -> None:
        self._bench, self._listener, self._daemon = bench, listener, daemon
        self._port = open_raw()

    async def arrive(self) -> str:
        """Samples arrive, all nodes in each."""
        await self._until(self._is_ready, "a status with all devices")
        await self._counted("samples_complete", 20)
        name = self._listener.statuses[-1].drivers[0].identity["name"]
        return f"{self.counters()['samples_complete']} complete; {name}"

    async def synchronise(self) -> str:
        """It is the kernel that sends the SYNCs."""
        begun_s, least = time.monotonic(), can_interface.periodic_frames()

        def sent() -> int:
            """Return how many since the device was opened last, or since the start."""
            nonlocal least
            n = can_interface.periodic_frames()
            least = min(least, n)
            return n - least

        await self._until(lambda: sent() > 2 * TRACKING_HZ, "frames of the manager")
        n, seconds = sent(), time.monotonic() - begun_s
        assert not self._listener.events_of("device.sync_by_host")
        return (
            f"the broadcast manager sent {n} in {seconds:.1f} s at {TRACKING_HZ:g} Hz"
        )

    async def ignore(self) -> str:
        """Strangers' frames do not reach the daemon."""
        missing = set(identifiers(NODES)) - can_interface.exact_receivers()
        assert not missing, f"not asked for: {sorted(missing)}"
        await self._counted("samples_received", 1)
        before = self.counters()["frames_ignored"]
        for _ in range(500):
            send(self._port, 0x7A0, b"stranger")
        await self._counted("samples_received", 40)
        n = self.counters()["frames_ignored"] - before
        assert n < 100, f"{n} of 500 reached it"
        return f"{n} of 500 frames of a stranger reached it"

    async def measure(self) -> str:
        """Points that are requested at rest are where the ball is.

        One that is refused, since an emulated encoder was late, is requested again.
        """
        points: list[Point] = []
        n_touches = len(self._edges(1))  # the first ones may be over
        n_last = n_touches + MOST_TOUCHES
        while len(points) < N_POINTS:
            n_touches = max(n_touches + 1, len(self._edges(1)))
            assert n_touches <= n_last, (
                f"{len(points)} points of {MOST_TOUCHES} touches"
            )
            await self._until(lambda n=n_touches: len(self._edges(1)) >= n, "a touch")
            points += await self._points_of_touch(n_touches)
        rounding_mm = MatrixArm(self._bench.arm_file).resolution_mm()
        centres_mm = np.array([edge["centre_mm"] for edge in self._edges(1)])
        off_mm = [
            np.abs(centres_mm - point.xyz_mm).max(axis=1).min() for point in points
        ]
        assert max(off_mm) < 2 * rounding_mm, f"{max(off_mm):.6f} mm, {rounding_mm}"
        return f"{N_POINTS} points, at most {max(off_mm) * 1e6:.0f} nm beside the truth"

    async def go_bus_off(self) -> str:
        """The controller's state of its bus, in the kernel's error frames."""
        send(self._port, ERROR_FRAME | BUS_OFF, bytes(8))
        await self._event("alarm.bus_off", True)
        send(self._port, ERROR_FRAME | RESTARTED, bytes(8))
        await self._event("alarm.bus_off", False)
        return "alarm.bus_off began and ended"

    async def stand_still(self) -> str:
        """A daemon that was stopped reports its losses, and measures on."""
        code = "device.frames_overflowed"
        for _ in range(TRIES):  # a device that is lost just then has no frames to lose
            await self._until(self._is_ready, "all devices")
            self._daemon.process.send_signal(signal.SIGSTOP)
            for _ in range(FLOOD):
                send(self._port, HEARTBEAT + NODES[0], b"\x05")
            self._daemon.process.send_signal(signal.SIGCONT)
            with contextlib.suppress(AssertionError):
                await self._listener.event(code, None, SOON_S)
                break
        event = await self._event(code, None)
        await self._counted("samples_complete", 20)
        return f"{event.count} event: {event.text}"

    async def lose(self) -> str:
        """The interface is taken down and up again."""
        n_before = len(self._listener.events)
        can_interface.ip("set", NAME, "down")
        await self._event("device.lost", True)
        can_interface.ip("set", NAME, "up")
        await self._event("device.lost", False)
        await self._until(self._is_ready, "ready again")
        await self._counted("samples_complete", 20)
        events = [_described(e) for e in self._listener.events[n_before:]]
        return ", ".join(events)

    async def stay(self) -> str:
        """Most samples are whole, though simulator and daemon are emulated."""
        begun_s, before = time.monotonic(), self.counters()
        await self._counted("samples_received", STEADY)
        now = self.counters()
        came, n_complete = (
            now[name] - before[name]
            for name in ("samples_received", "samples_complete")
        )
        planned = int((time.monotonic() - begun_s) * TRACKING_HZ)
        summary = (
            f"{planned} samples planned, {came} came, {n_complete} of them complete"
        )
        assert 2 * n_complete > came, summary
        return summary

    def counters(self) -> Counter[str]:
        devices = self._listener.healths[-1].devices
        return Counter(next(d.counters for d in devices if d.id == "base"))

    async def _points_of_touch(self, n_touches: int) -> list[Point]:
        """One point while the arm rests at a touch; none where all were refused."""

        def is_held() -> bool:
            return len(self._edges(0)) < n_touches

        arrived = self._listener.points
        while is_held():
            n_points = len(arrived)
            if (await self._listener.command(PointArgs())).ok:
                await self._until(lambda n=n_points: len(arrived) > n, "the point")
                return arrived[n_points:] if is_held() else []
        return []

    def _edges(self, level: int) -> list[dict[str, Any]]:
        """Presses, or releases, of the truth log that is still being written."""
        path = self._bench.folder / "truth.jsonl"
        if not path.exists():
            return []
        lines = path.read_text("utf-8").splitlines(keepends=True)
        edges = [json.loads(line) for line in lines if line.endswith("\n")]
        return [e for e in edges if e["event"] == "edge" and e["level"] == level]

    def _is_ready(self) -> bool:
        statuses = self._listener.statuses
        return bool(statuses) and statuses[-1].state in MEASURING

    async def _counted(self, name: str, increase: int) -> None:
        await self._until(lambda: self._listener.healths, "a health message")
        target = self.counters()[name] + increase
        await self._until(
            lambda: self.counters()[name] >= target, f"{increase} more {name}"
        )

    async def _event(self, code: str, active: bool | None) -> Event:
        events_of = self._listener.events_of
        await self._until(lambda: events_of(code, active), f"event {code}")
        return events_of(code, active)[-1]

    async def _until(self, condition: Callable[[], object], what: str) -> None:
        """Wait for as many of the daemon's health messages as come in two minutes."""
        await until_heard(
            condition, what, lambda: len(self._listener.healths), HEALTHS, SOON_S
        )


def _described(event: Event) -> str:
    state = {True: " begins", False: " ends", None: ""}[event.active]
    return event.code + state


def scan() -> str:
    """`traverse can scan` finds all nodes."""
    words = ["can", "scan", "--interface", "socketcan", "--channel", NAME]
    done = subprocess.run(
        [sys.executable, "-m", "traverse", *words, "--timeout", "3", "--json"],
        stdout=subprocess.PIPE,
        check=True,
    )
    nodes = json.loads(done.stdout)["nodes"]
    numbers = [node["node"] for node in nodes]
    assert numbers == list(NODES), numbers
    assert not any(node["problem"] for node in nodes), nodes
    return f"nodes {numbers}, {nodes[0]['counts_per_turn']} counts per turn"


async def check_arm(table: Table, folder: Path) -> None:
    program = programs.find("mosquitto")
    assert program is not None, "there is no mosquitto"
    broker = Mosquitto(folder, program=program)
    broker.start()
    bench = Workbench(folder, broker.host, broker.port)
    write_files(bench)
    try:
        async with listening(bench.host, bench.port, bench.arm) as listener:
            with bench.simulator() as simulator:
                await simulator.says("ready handle", START_S)
                await table.check("traverse can scan", scan)
                with bench.daemon() as daemon:
                    await _check_running(table, ArmOnBus(bench, listener, daemon))
                    await table.check("the daemon ends in order", lambda: _end(daemon))
    finally:
        broker.stop()


async def _check_running(table: Table, arm: ArmOnBus) -> None:
    await table.check("samples arrive", arm.arrive)
    await table.check("SYNC by the kernel", arm.synchronise)
    await table.check("filters of the daemon's socket", arm.ignore)
    await table.check("points within quantisation", arm.measure)
    await table.check(f"a whole arm for {STEADY} samples", arm.stay)
    await table.check("bus-off, reported by error frames", arm.go_bus_off)
    await table.check("a daemon that stood still", arm.stand_still)
    await table.check(f"ip link set {NAME} down, up", arm.lose)


async def _end(program: Program) -> str:
    program.process.terminate()
    status = await program.ended(SOON_S)
    assert status == 0, f"status {status}"
    return "status 0"
