"""Supervision besides positions: restarted nodes, emergencies, state of the bus.

Called between two reads of the bus. Its questions to a node read the bus meanwhile, so
no position waits for them; only one node is dealt with at a time.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from traverse.drivers.base.values import DeviceError
from traverse.drivers.canopen.node import NodeFacts, read_facts, set_up_node
from traverse.drivers.canopen.node_watch import Conditions, NodeMonitor
from traverse.drivers.canopen.options import CanOpenOptions
from traverse.drivers.canopen.sdo import NodeError, NodeSdo
from traverse.drivers.canopen.sync_cycles import SyncCycleAssembler
from traverse.drivers.canopen.sync_source import SyncScheduler
from traverse.drivers.io.can_bus import CanBus
from traverse.plurals import counted
from traverse.protocol.canopen import frames as wire
from traverse.protocol.canopen import objects
from traverse.protocol.canopen.errors import decode_error

LOOK_NS = 50_000_000
SET_UP_AGAIN_NS = 500_000_000
AMBIGUOUS_NS = 500_000_000
BACK_ON_BUS_NS = 200_000_000
COUNTED = {
    "delivered": "samples_received",
    "complete": "samples_complete",
    "late": "answers_late",
    "strays": "answers_stray",
    "pauses": "sync_pauses",
}
"""Counts of the cycles, and under which names they are counted for `health`."""


@dataclass(slots=True)
class NodeSupervisor:
    """Looks after the nodes of one connection.

    ``report_fault`` takes code, text, remedy, and how often.
    """

    bus: CanBus
    sdos: Sequence[NodeSdo]
    facts: Sequence[NodeFacts]
    cycles: SyncCycleAssembler
    scheduler: SyncScheduler
    watch: NodeMonitor
    conditions: Conditions
    options: CanOpenOptions
    now_ns: Callable[[], int]
    report_fault: Callable[[str, str, str, int], None]
    counters: Counter[str]
    _restarted: Sequence[int] = ()
    _look_due_ns: int = 0
    _status_due_ns: int = 0
    _status_turn: int = 0
    _set_up_due_ns: int = 0
    _bus_off_ns: int = 0
    _certain_ns: int = 0
    _dropped: int = 0

    def observe(self) -> None:
        """Note which nodes live and what was lost; sends no request, so it never waits.

        Raises:
            DeviceError: all nodes are lost.
        """
        now_ns = self.now_ns()
        if now_ns < self._look_due_ns:
            return
        self._look_due_ns = now_ns + LOOK_NS
        self._note_answers(now_ns)
        self._report_losses()
        self._restarted = self.watch.look(now_ns) or self._long_ambiguous(now_ns)
        for channel in range(len(self.sdos)):
            self.cycles.status[channel] = self.watch.status(channel)
        if self.watch.all_lost(now_ns):
            raise DeviceError(
                f"all nodes on {self.bus.name} are silent",
                "check the power of the encoders and the cable of the bus",
            )

    def act(self) -> None:
        """Check one node, if one is due; `observe` continues meanwhile.

        Raises:
            DeviceError: all nodes are lost, or one has changed.
        """
        now_ns = self.now_ns()
        if self._restarted and now_ns >= self._set_up_due_ns:
            self._set_up_again(self._restarted[0])
            self._set_up_due_ns = self.now_ns() + SET_UP_AGAIN_NS
        elif self.options.status_period_s and now_ns >= self._status_due_ns:
            period_s = self.options.status_period_s / len(self.sdos)
            self._status_due_ns = now_ns + int(period_s * 1e9)
            self._request_alarms(self._status_turn)
            self._status_turn = (self._status_turn + 1) % len(self.sdos)

    def emergency(self, channel: int, message: wire.Emergency) -> None:
        """An emergency was received: check that node next."""
        self.watch.emergency(channel, message)
        self._status_turn, self._status_due_ns = channel, 0

    def error_frame(self, can_id: int, data: bytes | bytearray, at_ns: int) -> None:
        """The controller has reported the state of its bus."""
        told = decode_error(can_id, data)
        if told.bus_off:
            self._bus_off_ns = at_ns
            text = f"{self.bus.name} is off: its controller saw too many errors"
            self.conditions.report(None, "bus_off", text)
        elif told.restarted:
            self.conditions.end(None, "bus_off")
        if told.passive:
            text = f"{self.bus.name} is disturbed: its controller is error passive"
            self.conditions.report(None, "bus_passive", text)
        elif told.active or told.restarted:
            self.conditions.end(None, "bus_passive")
        if told.overflow:
            self.cycles.note_lost_frames()
            self._report_overflow(1)

    def _long_ambiguous(self, now_ns: int) -> list[int]:
        """Channels to restart with another master's SYNCs, which cannot be paused."""
        ambiguous = self.cycles.ambiguous
        if not ambiguous or self.options.sync != "external":
            self._certain_ns = now_ns
        if now_ns - self._certain_ns < AMBIGUOUS_NS:
            return []
        return [
            channel for channel in range(len(self.sdos)) if ambiguous >> channel & 1
        ]

    def _note_answers(self, now_ns: int) -> None:
        cycles = self.cycles
        seen, cycles.seen = cycles.seen, 0
        for channel in range(len(self.sdos)):
            if seen >> channel & 1:
                self.watch.seen(channel, now_ns)
        if seen and now_ns - self._bus_off_ns > BACK_ON_BUS_NS:
            self.conditions.end(None, "bus_off")
        for channel, n in cycles.duplicates.items():
            sign = f"{n} second answers to one SYNC"
            self.watch.duplicate(channel, now_ns, sign)
            self.report_fault(
                "duplicate_answers",
                f"node {self.facts[channel].node}: {sign}",
                "see the alarm duplicate_node",
                n,
            )
        cycles.duplicates.clear()
        for channel, sdo in enumerate(self.sdos):
            if sdo.surplus:
                sdo.surplus = 0
                self.watch.duplicate(channel, now_ns, "two answers to one question")

    def _set_up_again(self, channel: int) -> None:
        sdo, known = self.sdos[channel], self.facts[channel]
        try:
            self.bus.send(wire.NMT, wire.nmt_command(wire.PRE_OPERATIONAL, known.node))
            found = read_facts(sdo, known.node)
            if (found.counts_per_turn, found.modulus) != (
                known.counts_per_turn,
                known.modulus,
            ):
                raise DeviceError(
                    f"{sdo.name} restarted with {found.counts_per_turn} counts per turn"
                    f", it had {known.counts_per_turn}",
                    "if it was replaced, correct the arm file and identify anew",
                )
            forgotten = set_up_node(sdo, found, self.options)
        except NodeError:
            return  # it stays lost; it is tried again
        self.bus.send(wire.NMT, wire.nmt_command(wire.START, known.node))
        self.watch.mark_set_up(channel, self.now_ns())
        if self.options.sync == "external":
            self.cycles.reset_attribution(1 << channel)
        self._restarted = ()
        self.watch.complaints(channel, found.alarms, found.warnings)
        if forgotten:
            self.report_fault(
                "node_restarted",
                f"node {known.node} has restarted; it is set up again and measures",
                "check its power supply; check a known point before measuring on",
                1,
            )

    def _request_alarms(self, channel: int) -> None:
        sdo = self.sdos[channel]
        if self.conditions.is_raised(channel, "node_lost"):
            return
        try:
            alarms = sdo.find_number(objects.ALARMS) or 0
            warnings = sdo.find_number(objects.WARNINGS) or 0
        except NodeError:
            return  # its heartbeat shows whether it is lost
        self.watch.complaints(channel, alarms, warnings)

    def _report_losses(self) -> None:
        """Report what was lost since the last time, and count it for `health`."""
        cycles = self.cycles
        for name, counter in COUNTED.items():
            self.counters[counter] += getattr(cycles, name)
            setattr(cycles, name, 0)
        lost, cycles.lost = cycles.lost, 0
        if lost:
            self.report_fault(
                "samples_lost",
                f"{counted(lost, 'sample')} lost: no node answered, or no SYNC was "
                "sent",
                "lower the rate; check the load of bus and computer",
                lost,
            )
        for channel, n in cycles.missing.items():
            self.counters[f"missing_node_{self.options.nodes[channel]}"] += n
        self._report_by_node(
            cycles.missing,
            "readings_missing",
            "SYNCs without an answer",
            "check these encoders; lower the rate if it is all of them",
        )
        self._report_by_node(
            cycles.doubtful,
            "answers_doubtful",
            "answers that may be of another SYNC, flagged late",
            "check these encoders and the load of the bus; lower the rate",
        )
        dropped, self._dropped = self.bus.dropped - self._dropped, self.bus.dropped
        if dropped > 0:
            self._report_overflow(dropped)

    def _report_overflow(self, n: int) -> None:
        """Frames arrived and could not be stored."""
        self.report_fault(
            "frames_overflowed",
            f"frames were lost on {self.bus.name} because they were not read in time",
            "lower the rate; give the daemon more of the computer; on SocketCAN let it "
            "keep more: sysctl net.core.rmem_max=4194304",
            n,
        )

    def _report_by_node(
        self, counts: Counter[int], code: str, what: str, remedy: str
    ) -> None:
        if not counts:
            return
        who = ", ".join(
            f"node {self.options.nodes[channel]}: {n}"
            for channel, n in sorted(counts.items())
        )
        self.report_fault(code, f"{what}: {who}", remedy, counts.total())
        counts.clear()
