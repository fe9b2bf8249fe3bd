"""A world: built from its plan, run in virtual time, judged as it goes."""

import asyncio
import contextlib
import logging
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.honesty.arm import LIBRARY, PACES, arm_truth, play, write_arm
from benchmarks.honesty.cable import Cable, Delay, DeviceEnd, open_host_end
from benchmarks.honesty.can import HostBus, MemoryLine
from benchmarks.honesty.count_faults import COUNT_KINDS, CountFaults
from benchmarks.honesty.daemon import (
    AtOnce,
    DaemonRun,
    WorldClock,
    to_thread_at_once,
)
from benchmarks.honesty.devices import MountedDevice, mount
from benchmarks.honesty.families import FAMILIES
from benchmarks.honesty.hub import Housed, Hub
from benchmarks.honesty.judge import Judge, Tally
from benchmarks.honesty.loop import VirtualLoop
from benchmarks.honesty.plan import (
    ALL_DEVICES,
    ANSWER_S,
    OF_LINE,
    OF_POWER,
    Action,
    Plan,
    PlannedFault,
    draw_plan,
    least_delay_s,
)
from benchmarks.honesty.timeline import device_timeline, host_timeline
from benchmarks.honesty.unread import MOST_FAILED
from benchmarks.trials.lines import Line
from traverse.daemon.config.devices import DeviceSection
from traverse.daemon.config.schema import (
    ArmSection,
    CaptureSection,
    Configuration,
    InputSection,
)
from traverse.daemon.errors import CaptureRefusedError, RequestRefusedError
from traverse.daemon.monitoring.events import Occurrence
from traverse.daemon.state_dir import PROBE
from traverse.protocol.messages import (
    HomeArgs,
    PointArgs,
    ProbeArgs,
    ReferenceArgs,
    ScanArgs,
)
from traverse.simulator.devices.table import DeviceTable
from traverse.simulator.scenario.faults import Fault
from traverse.simulator.scenario.wiring import ScriptClock

UTC_S = 1_798_761_600.0  # true UTC at the true time 0: the beginning of 2027
SERIAL_DRIVERS = ("latch_board", "text_line", "microscribe")
DAY_S = 86_400.0
# How far an unmarked UTC may be back and ahead: as the daemon states it.
SYNCHRONISED_S, ALONE_S = (1.0, 1.0), (60.0 + DAY_S + 60.0, 400.0 * DAY_S)
CHANGE_S, RETRY_S = 0.1, 0.5  # of a probe that is changed; of a start that is refused


@dataclass(eq=False)
class Outcome:
    """Outcome of a world."""

    plan: Plan
    tally: Tally = field(default_factory=Tally)
    refused: Counter[str] = field(default_factory=Counter)
    events: Counter[str] = field(default_factory=Counter)
    cpu_s: float = 0.0
    error: str = ""


class World:
    """All of it.

    Args:
        note: Called with lines for people.
    """

    def __init__(self, plan: Plan, folder: Path, *, is_verbose: bool = False) -> None:
        self.plan, self._folder, self._is_verbose = plan, folder, is_verbose
        self._family = FAMILIES[plan.family]
        self._rng = np.random.default_rng([plan.seed, 0x576F])
        self.hub = Hub(host_timeline(plan))
        self._cables: dict[str, Cable] = {}
        sources = self._family.sources(is_incremental=plan.is_incremental)
        write_arm(folder, sources, self._rng, is_identified=plan.is_identified)
        script = play(PACES[plan.pace], plan.duration_s, self._rng, plan.homes_s)
        self._script, self._script_clock = script, ScriptClock(0.0)
        self.truth = arm_truth(folder, script, UTC_S, plan.seed)
        self.judge = Judge(
            self.hub,
            self.truth,
            lambda true_s: UTC_S + true_s,
            lambda: SYNCHRONISED_S if self._is_synchronised() else ALONE_S,
            self._note,
            presses_s=[event.time_s for event in script.events if event.level]
            if self._family.latches_edges
            else (),
            latches_places=self._family.n_devices == 1,
            freezes_s=[
                (fault.at_s, fault.lasts_s)
                for fault in plan.faults
                if fault.kind == "host_freeze"
            ],
        )
        # The arm was measured with yesterday.
        good_ns = round(1e9 * (UTC_S - DAY_S))
        (folder / "utc.json").write_text(f'{{"good_ns": {good_ns}, "confirmed_ns": 0}}')
        self._configuration = self._configured()
        self._clock = WorldClock(self.hub, self._utc_s)
        self.outcome = Outcome(plan, self.judge.tally)
        self._mounted: list[MountedDevice] = []
        self._daemon: DaemonRun | None = None
        self._swapped = False
        self.count_faults = CountFaults(
            plan,
            self._family,
            self._rng,
            self.truth,
            self.hub,
            self.judge,
            self._mounted,
            lambda: self._daemon,
            self._note,
        )

    def _note(self, text: str) -> None:
        if self._is_verbose:
            print(text)

    # -- building -----------------------------------------------------------------

    def _configured(self) -> Configuration:
        capture = CaptureSection(
            inputs=(InputSection(source=self._family.button, trigger="button"),)
        )
        return Configuration(
            arm=ArmSection(file="arm.toml", probes=LIBRARY),
            device=tuple(
                DeviceSection.from_table({"id": spec.id, **spec.section})
                for spec in self._family.devices
            ),
            capture=capture,
        )

    @contextlib.contextmanager
    def _in_memory(self) -> Iterator[None]:
        """Use ports, buses and sleeping of the world within the block."""
        hub = self.hub

        def device_end(path: Path, buffer_bytes: int) -> DeviceEnd:
            return DeviceEnd(self._cables[str(path)], buffer_bytes)

        def serial_port(path: str, baud_rate: int, wake_fd: int, **line: object) -> Any:  # noqa: ANN401
            return open_host_end(hub, path, baud_rate)

        def can_line(interface: str, channel: str) -> MemoryLine:
            return MemoryLine(self._cables[f"/ports/{channel}"], channel)

        def can_bus(
            interface: str, channel: str, bit_rate: int, **options: Any
        ) -> HostBus:
            return HostBus(hub.ports[f"/ports/{channel}"], channel)

        with contextlib.ExitStack() as stack:
            for place, stand_in in (
                ("traverse.simulator.devices.serial_line.PtyPort", device_end),
                ("traverse.simulator.devices.latch_board.device.PtyPort", device_end),
                ("traverse.simulator.devices.canopen.device.LibraryLine", can_line),
                ("traverse.drivers.canopen.driver.CanBus", can_bus),
                *(
                    (f"traverse.drivers.{name}.driver.SerialPort", serial_port)
                    for name in SERIAL_DRIVERS
                ),
                (
                    "traverse.daemon.references.memory_file.ThreadPoolExecutor",
                    AtOnce,
                ),
                ("traverse.daemon.utc.ThreadPoolExecutor", AtOnce),
                ("asyncio.to_thread", to_thread_at_once),
                ("time.sleep", hub.sleep),
            ):
                stack.enter_context(patch(place, stand_in))
            yield

    def _build_devices(self) -> None:
        plan = self.plan
        for number, spec in enumerate(self._family.devices):
            least_s, usual_s, bunch_s = plan.delays_s[number]
            cables = []
            for port in spec.ports:
                down, up = (
                    Delay(
                        least_s, usual_s, bunch, np.random.default_rng([plan.seed, k])
                    )
                    for k, bunch in enumerate((bunch_s, 0.0))
                )
                cable = Cable(self.hub, down, up)
                self._cables[port] = self.hub.ports[port] = cable
                cables.append(cable)
            self.hub.cables += cables
            table = DeviceTable.from_table({"id": spec.id, **spec.table})
            mounted = mount(
                table,
                self.truth.nominal,
                self.truth.course,
                self._script,
                timeline=device_timeline(plan, number),
                faults=self._device_faults(table, number),
                seed=(plan.seed % 60_000, number),
                clock=self._script_clock,
            )
            if plan.is_incremental:
                mounted.source.count_from_zero(0.0)
            self._mounted.append(mounted)
            self.hub.devices.append(Housed(mounted.device, cables))

    def _device_faults(self, table: DeviceTable, number: int) -> tuple[Fault, ...]:
        faults = []
        for fault in self.plan.faults:
            if fault.device != number:
                continue
            entry: dict[str, Any] = {"at_s": fault.at_s, "duration_s": fault.lasts_s}
            if fault.kind in OF_LINE and fault.kind in table.FAULTS:
                entry |= {"kind": fault.kind, "probability": min(1.0, fault.size)}
            elif fault.kind in OF_POWER:
                entry["kind"] = "gone"
            elif fault.kind == "bus_off":
                entry["kind"] = "bus_off"
            elif fault.kind == "unread":
                entry |= {"kind": "unread", "probability": fault.size}
                entry["channel"] = self.count_faults.unread_channel(fault)
                entry["most"] = self.plan.seed % MOST_FAILED + 1
            else:
                continue
            faults.append(Fault.from_table(entry))
        for begin_s, end_s, kind in self.plan.restarts:
            if kind:
                lasts_s = end_s - begin_s - 0.2
                faults.append(
                    Fault.from_table(
                        {"kind": "gone", "at_s": begin_s, "duration_s": lasts_s}
                    )
                )
        return tuple(faults)

    # -- faults --------------------------------------------------------------------

    def _schedule(self, fault: PlannedFault) -> None:
        hub, end_s = self.hub, fault.at_s + fault.lasts_s
        cables = hub.devices[fault.device].cables
        if fault.device == ALL_DEVICES:
            cables = hub.cables
        if fault.kind == "delays" and fault.lasts_s:
            hub.at(fault.at_s, lambda: self._delay(fault, cables))
            hub.at(end_s, lambda: self._delay(None, cables))
        elif fault.kind == "process_stall":
            hub.at(fault.at_s, lambda: self._stall(end_s, readers=True))
        elif fault.kind == "loop_stall":
            hub.at(fault.at_s, lambda: self._stall(end_s, readers=False))
        elif fault.kind == "host_freeze":
            hub.at(fault.at_s, lambda: self._stall(end_s, readers=True))
        elif fault.kind in OF_POWER:
            self._look_at_power(fault)
        elif fault.kind in ("unplug", "usb_reset"):
            hub.at(fault.at_s, lambda: _each(cables, Cable.unplug))
            hub.at(end_s, lambda: _each(cables, Cable.plug))
        elif fault.kind == "probe_table":
            library = self._folder / LIBRARY
            hub.at(fault.at_s, lambda: library.rename(self._folder / "elsewhere"))
            hub.at(end_s, lambda: (self._folder / "elsewhere").rename(library))
        elif fault.kind == "swap":
            self._schedule_swap(fault)
        elif fault.kind in COUNT_KINDS:
            self.count_faults.schedule(fault)
        self._note(f"          fault {fault}")

    def _look_at_power(self, fault: PlannedFault) -> None:
        mounted, housed = self._mounted[fault.device], self.hub.devices[fault.device]
        end_s, n = fault.at_s + fault.lasts_s, len(mounted.source.offsets)

        def mount_another() -> None:
            if fault.kind == "exchange":
                turns = self._rng.uniform(-0.4, 0.4, n).tolist()
                mounted.exchange(7, turns)
            elif fault.kind == "incremental" or self.plan.is_incremental:
                mounted.source.count_from_zero(end_s)

        self.hub.at(fault.at_s, lambda: housed.live(self.hub.now_s))
        self.hub.at(end_s, mount_another)
        self.hub.at(end_s, lambda: housed.live(self.hub.now_s))

    def _delay(self, fault: PlannedFault | None, cables: list[Cable]) -> None:
        for cable in cables:
            number = self.hub.cables.index(cable)
            if fault is None:
                least_s, usual_s = 2e-4, 1e-4
            else:
                rng = np.random.default_rng([self.plan.seed, number, 7])
                least_s = least_delay_s(self.plan, fault)
                usual_s = float(10 ** rng.uniform(-4, -1.6))
            for delay in (cable.down, cable.up):
                delay.least_s, delay.usual_s = least_s, usual_s

    def _stall(self, end_s: float, *, readers: bool) -> None:
        hub = self.hub
        hub.loop_stalled_s = max(hub.loop_stalled_s, end_s)
        if readers:
            hub.readers_stalled_s = max(hub.readers_stalled_s, end_s)

    def _schedule_swap(self, fault: PlannedFault) -> None:
        hub = self.hub
        groups = [spec.ports for spec in self._family.devices if spec.ports]
        if len(groups[0]) > 1:
            picked = self._rng.choice(groups[0], 2, replace=False).tolist()
        else:
            picked = [groups[0][0], groups[1][0]]
        first, second = (self._cables[str(port)] for port in picked)

        def swap() -> None:
            hub.ports[picked[0]], hub.ports[picked[1]] = second, first
            self._swapped = True
            _each([first, second], Cable.plug)

        hub.at(fault.at_s, lambda: _each([first, second], Cable.unplug))
        hub.at(fault.at_s + fault.lasts_s, swap)

    def _utc_s(self) -> float:
        now_s = self.hub.now_s
        believed_s = UTC_S + now_s
        for fault in self.plan.faults:
            if (
                (fault.kind == "utc_step" and now_s >= fault.at_s)
                or (fault.kind == "utc_ahead" and now_s < fault.lasts_s)
                or (fault.kind == "utc_set" and now_s < fault.at_s)
            ):
                believed_s += fault.size
            elif fault.kind == "utc_1970" and now_s < fault.lasts_s:
                believed_s = now_s + 20.0
        return max(believed_s, now_s)  # Linux refuses a time before its own start

    def _is_synchronised(self) -> bool:
        """Return whether the kernel says that a program keeps UTC."""
        now_s = self.hub.now_s
        return not any(
            (fault.kind == "utc_step" and now_s >= fault.at_s)
            or (fault.kind == "utc_set" and now_s < fault.at_s)
            or (fault.kind in ("utc_ahead", "utc_1970") and now_s < fault.lasts_s)
            for fault in self.plan.faults
        )

    # -- running -------------------------------------------------------------------

    def run(self) -> Outcome:
        begun_s = time.process_time()
        with self._in_memory():
            self._build_devices()
            for fault in self.plan.faults:
                self._schedule(fault)
            for begin_s, end_s, kind in self.plan.restarts:
                if kind:
                    self._restart_devices(begin_s, end_s - 0.2, kind)
            loop = VirtualLoop(self.hub)
            try:
                loop.run_until_complete(self._live())
            finally:
                loop.close()
        self.judge.finish()
        self.outcome.cpu_s = time.process_time() - begun_s
        return self.outcome

    def _restart_devices(self, begin_s: float, end_s: float, kind: str) -> None:
        for number in range(len(self._mounted)):
            self._look_at_power(
                PlannedFault(kind, begin_s, end_s - begin_s, device=number)
            )

    async def _live(self) -> None:
        plan = self.plan
        begin_s, last = 0.0, (plan.duration_s, plan.duration_s, "")
        for end_s, next_s, _ in [*plan.restarts, last]:
            await self._run_daemon(begin_s, end_s)
            begin_s = next_s
            if next_s < plan.duration_s:
                await self._until(begin_s)
                while self._lacks_probe():
                    begin_s += RETRY_S
                    await self._until(begin_s)
                if any(
                    f.kind == "computer_restart" and f.at_s == end_s
                    for f in plan.faults
                ):
                    self.hub.booted_s = self.hub.loop_s - 5.0

    def _lacks_probe(self) -> bool:
        """Whether the daemon refuses to start: a probe is in use, its library away."""
        is_chosen = (self._folder / PROBE).exists()
        return is_chosen and not (self._folder / LIBRARY).exists()

    async def _run_daemon(self, begin_s: float, end_s: float) -> None:
        judge, events = self.judge, self.outcome.events

        def offset_ns(run: DaemonRun) -> int:
            return run.measurement.clock.utc_offset_ns()

        def take_event(event: Occurrence) -> None:
            events[event.code] += 1
            judge.take_doubt(event.data)
            if "fault in the driver" in event.text:
                raise RuntimeError(event.text)
            self._note(
                f"{self.hub.now_s:9.4f} event {event.code} {event.source} "
                f"{'' if event.active is None else event.active} {event.text}"
            )

        daemon = DaemonRun(
            self.hub,
            self._clock,
            self._configuration,
            self._folder,
            take_point=lambda run, point: judge.point(point, offset_ns(run)),
            take_scan=lambda run, scan: judge.scan(scan, offset_ns(run)),
            take_live=lambda run, live: judge.live(live, offset_ns(run)),
            take_event=take_event,
            is_synchronised=self._is_synchronised,
        )
        self._daemon = daemon
        try:
            starting = asyncio.ensure_future(daemon.start())
            operating = asyncio.ensure_future(
                self._operate(daemon, starting, begin_s, end_s)
            )
            await self._until(end_s)
            for task in (operating, starting):
                task.cancel()
            done = await asyncio.gather(operating, starting, return_exceptions=True)
            for result in done:
                if isinstance(result, Exception):
                    raise result
            daemon.check()
        finally:
            self._daemon = None
            await daemon.end()

    async def _until(self, true_s: float) -> None:
        left_s = self.hub.host.at(true_s) - self.hub.loop_s
        await asyncio.sleep(max(0.0, left_s))

    async def _operate(
        self,
        daemon: DaemonRun,
        starting: "asyncio.Future[None]",
        begin_s: float,
        end_s: float,
    ) -> None:
        await starting
        for action in self.plan.actions:
            if begin_s <= action.at_s < end_s:
                await self._until(action.at_s)
                try:
                    async with asyncio.timeout(ANSWER_S + action.size):
                        await self._act(daemon, action)
                except (RequestRefusedError, CaptureRefusedError) as error:
                    self.outcome.refused[getattr(error, "code", "refused")] += 1
                    self._note(f"{self.hub.now_s:9.4f} refused: {error}")
                except TimeoutError:
                    self.outcome.refused["timeout"] += 1
                    self._note(f"{self.hub.now_s:9.4f} {action.kind}: no answer")

    async def _act(self, daemon: DaemonRun, action: Action) -> None:
        if action.kind == "point":
            await daemon.points.take_point(PointArgs())
        elif action.kind == "mean":
            await daemon.points.take_point(PointArgs(dwell_s=0.3))
        elif action.kind == "scan":
            rate_hz = float(self._rng.choice(self._family.scans_hz))
            await daemon.scans.change_scan(ScanArgs(action="start", rate_hz=rate_hz))
            await asyncio.sleep(action.size)
            await daemon.scans.change_scan(ScanArgs(action="stop"))
        elif action.kind == "probe":
            await self._change_probe(daemon, "long" if action.size else "short")
        elif action.kind == "home":
            if not self._swapped:
                await daemon.points.home(HomeArgs())
        elif self._may_confirm():
            await daemon.points.confirm_reference(ReferenceArgs(action="confirm"))

    async def _change_probe(self, daemon: DaemonRun, name: str) -> None:
        """Put on another probe as soon as the daemon agrees; meanwhile all is void."""
        begun_s = self.hub.now_s
        await daemon.points.change_probe(ProbeArgs(name=name))
        self.truth.put_on(name, self.hub.now_s)
        until_s = self.hub.now_s + CHANGE_S
        self.judge.pardon(begun_s - CHANGE_S, until_s, is_named=False)

    def _may_confirm(self) -> bool:
        """Return whether the arm's positions are right, which the operator checks."""
        return not self._swapped and all(m.source.is_right for m in self._mounted)


def _each(cables: list[Cable], act: Any) -> None:  # noqa: ANN401 - a method of Cable
    for cable in cables:
        act(cable)


def run_world(plan: Plan, *, is_verbose: bool = False) -> Outcome:
    """Run one world in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="honesty-") as name:
        return World(plan, Path(name), is_verbose=is_verbose).run()


def world_line(seed: int) -> Line:
    logging.disable(logging.CRITICAL)
    plan = draw_plan(seed)
    outcome = run_world(plan)
    tally = outcome.tally
    return {
        "world": seed,
        "family": plan.family,
        "kinds": list(plan.kinds),
        "pace": plan.pace,
        "ok": dict(tally.ok),
        "doubt": dict(tally.doubt),
        "settled_doubt": dict(tally.settled),
        "lies": dict(tally.lies),
        "unseen": dict(tally.unseen),
        "press_off_s": tally.press_off_s,
        "press_share": tally.press_share,
        "jump_rad": list(tally.jump_rad),
        "flags": dict(tally.doubts),
        "examples": [str(lie) for lie in tally.examples[:3]],
        "refused": dict(outcome.refused),
        "cpu_s": outcome.cpu_s,
    }
