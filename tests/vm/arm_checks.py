"""A whole arm on vcan0: simulator, broker, daemon, as programs of their own."""

import asyncio
import json
import signal
import subprocess
import sys
from collections import Counter
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
from tests.vm.table import Table
from traverse.protocol.canopen.frames import HEARTBEAT, identifiers
from traverse.protocol.messages import Event, PointArgs
from traverse.testing.waiting import until

MEASURING = ("ready", "doubt")  # with all devices; the arm is not identified
START_S = 120.0
SOON_S = 40.0
ERROR_FRAME, BUS_OFF, RESTARTED = 0x2000_0000, 0x40, 0x100
FLOOD = 20_000
STEADY_S = 20.0


class ArmOnBus:
    """Checks while the programs run."""

    def __init__(self, bench: Workbench, listener: Listener, daemon: Program) -> None:
        self._bench, self._listener, self._daemon = bench, listener, daemon
        self._port = open_raw()

    async def arrive(self) -> str:
        """Samples arrive, all nodes in each."""
        await until(self._is_ready, "a status with all devices", START_S)
        await self._counted("samples_complete", 20)
        name = self._listener.statuses[-1].drivers[0].identity["name"]
        return f"{self.counters()['samples_complete']} complete; {name}"

    async def synchronise(self) -> str:
        """It is the kernel that sends the SYNCs."""
        before = can_interface.periodic_frames()
        await asyncio.sleep(2.0)
        n = can_interface.periodic_frames() - before
        assert n > TRACKING_HZ, f"the broadcast manager sent {n} in 2 s"
        assert not self._listener.events_of("device.sync_by_host")
        return f"the broadcast manager sent {n} in 2 s at {TRACKING_HZ:g} Hz"

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
        """Points that are requested at rest are where the ball is."""
        for n in range(1, N_POINTS + 1):
            await self._touched(n)
            reply = await self._listener.command(PointArgs())
            assert reply.ok, reply
            await self._listener.n_points(n, SOON_S)
        rounding_mm = MatrixArm(self._bench.arm_file).resolution_mm()
        pairs = zip(self._listener.points, self._touches(), strict=False)
        off_mm = [
            np.abs(np.array(p.xyz_mm) - edge["centre_mm"]).max() for p, edge in pairs
        ]
        assert len(off_mm) >= N_POINTS, f"{len(off_mm)} in the truth log"
        assert max(off_mm) < 2 * rounding_mm, f"{max(off_mm):.6f} mm, {rounding_mm}"
        return f"{N_POINTS} points, at most {max(off_mm) * 1e6:.0f} nm beside the truth"

    async def go_bus_off(self) -> str:
        """The controller's state of its bus, in the kernel's error frames."""
        send(self._port, ERROR_FRAME | BUS_OFF, bytes(8))
        await self._listener.event("alarm.bus_off", True, SOON_S)
        send(self._port, ERROR_FRAME | RESTARTED, bytes(8))
        await self._listener.event("alarm.bus_off", False, SOON_S)
        return "alarm.bus_off began and ended"

    async def stand_still(self) -> str:
        """A daemon that was stopped reports its losses, and measures on."""
        self._daemon.process.send_signal(signal.SIGSTOP)
        for _ in range(FLOOD):
            send(self._port, HEARTBEAT + NODES[0], b"\x05")
        self._daemon.process.send_signal(signal.SIGCONT)
        event = await self._listener.event("device.frames_overflowed", None, SOON_S)
        await self._counted("samples_complete", 20)
        return f"{event.count} event: {event.text}"

    async def lose(self) -> str:
        """The interface is taken down and up again."""
        n_before = len(self._listener.events)
        can_interface.ip("set", NAME, "down")
        await self._listener.event("device.lost", True, SOON_S)
        can_interface.ip("set", NAME, "up")
        await self._listener.event("device.lost", False, SOON_S)
        await until(self._is_ready, "ready again", SOON_S)
        await self._counted("samples_complete", 20)
        events = [_described(e) for e in self._listener.events[n_before:]]
        return ", ".join(events)

    async def stay(self) -> str:
        """Most samples are whole, though simulator and daemon are emulated."""
        before = self.counters()
        await asyncio.sleep(STEADY_S)
        now = self.counters()
        came, n_complete = (
            now[name] - before[name]
            for name in ("samples_received", "samples_complete")
        )
        planned = int(STEADY_S * TRACKING_HZ)
        summary = (
            f"{planned} samples planned, {came} came, {n_complete} of them complete"
        )
        assert 2 * n_complete > planned, summary
        return summary

    def counters(self) -> Counter[str]:
        """Counters of the CAN device, as last reported."""
        devices = self._listener.healths[-1].devices
        return Counter(next(d.counters for d in devices if d.id == "base"))

    async def _touched(self, n: int) -> None:
        await until(lambda: len(self._touches()) >= n, f"touch {n}", START_S)

    def _touches(self) -> list[dict[str, Any]]:
        """Presses of the truth log that is still being written."""
        path = self._bench.folder / "truth.jsonl"
        if not path.exists():
            return []
        lines = path.read_text("utf-8").splitlines(keepends=True)
        edges = [json.loads(line) for line in lines if line.endswith("\n")]
        return [e for e in edges if e["event"] == "edge" and e["level"] == 1]

    def _is_ready(self) -> bool:
        statuses = self._listener.statuses
        return bool(statuses) and statuses[-1].state in MEASURING

    async def _counted(self, name: str, increase: int) -> None:
        """Wait until a counter has increased."""
        await until(lambda: self._listener.healths, "a health message", SOON_S)
        target = self.counters()[name] + increase
        await until(
            lambda: self.counters()[name] >= target, f"{increase} more {name}", SOON_S
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
    """All of them, on one run of the programs, which end in order."""
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
    await table.check(f"a whole arm for {STEADY_S:g} s", arm.stay)
    await table.check("bus-off, reported by error frames", arm.go_bus_off)
    await table.check("a daemon that stood still", arm.stand_still)
    await table.check(f"ip link set {NAME} down, up", arm.lose)


async def _end(program: Program) -> str:
    program.process.terminate()
    status = await program.ended(SOON_S)
    assert status == 0, f"status {status}"
    return "status 0"
