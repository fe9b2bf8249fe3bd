"""Supervision of nodes and bus: presence, restarts, alarms.

A node is alive while anything of it is received; its heartbeat ensures that without
SYNCs. Lasting conditions are reported as alarms.

Called between two reads of the bus. Requests to a node read the bus meanwhile, so that
no position waits; one node is processed at a time.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from traverse.drivers.base.alarms import Alarms
from traverse.drivers.base.values import STATUS_ERROR, STATUS_WARNING, DeviceError
from traverse.drivers.canopen.node import (
    NodeFacts,
    NodeSettings,
    read_facts,
    read_settings,
    set_up_node,
    settings_text,
)
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
HEARTBEATS_MISSED = 3.5  # in a row, before a node counts as lost
TWO_BOOT_UPS_NS = 100_000_000  # closer together than one node can boot twice
DUPLICATE_LASTS_NS = 5_000_000_000  # after the last sign of it

COUNTED = {
    "delivered": "samples_received",
    "complete": "samples_complete",
    "late": "answers_late",
    "strays": "answers_stray",
    "pauses": "sync_pauses",
}
"""Counters of the cycles, and their names in `health`."""

REMEDIES = {
    "node_lost": "check power and cable of this encoder; the arm measures on with its "
    "last angle, and points are flagged incomplete",
    "duplicate_node": "two encoders have this number, or one sends unasked: take them "
    "off one by one, and give each its own number",
    "emergency": "see the encoder's manual; if it persists, replace the encoder",
    "encoder_alarm": "its position is not valid: check mounting, magnet or disc, then "
    "replace it",
    "encoder_warning": "the position is still valid; see the encoder's manual for when "
    "to service it",
    "bus_off": "check the termination (120 ohm at both ends), the bit rate of all "
    "nodes and the cable; the bus recovers by itself if its interface has restart-ms",
    "bus_passive": "many frames are broken: check termination, cable and bit rate",
}


class Conditions(Alarms):
    """Conditions of the nodes and of the bus, each with its remedy."""

    def report(self, channel: int | None, code: str, text: str, value: int = 0) -> None:
        """Raise an alarm, or change its text."""
        self.begin(channel, code, text, REMEDIES[code], value)


@dataclass(slots=True)
class SupervisedNode:
    """One node of a connection.

    Attributes:
        settings: what its frames mean, as it was set up.
        settings_ns: when they were read last.
        last_seen_ns: when anything of it was received last.
        started_ns: when it was commanded to be operational.
        boot_ns: its last boot-up; 0 for none.
        duplicate_ns: when it last seemed to be two.
        wants_set_up: it restarted and lost its settings.
        idle: it lives, but is not operational.
        alarms, warnings: of its objects 6503 and 6505.
    """

    sdo: NodeSdo
    facts: NodeFacts
    settings: NodeSettings
    settings_ns: int
    last_seen_ns: int
    started_ns: int
    boot_ns: int = 0
    duplicate_ns: int = 0
    wants_set_up: bool = False
    idle: bool = False
    alarms: int = 0
    warnings: int = 0
    emergencies: set[int] = field(default_factory=set)

    @property
    def number(self) -> int:
        return self.facts.node


@dataclass(slots=True)
class NodeSupervisor:
    """Supervises the nodes of one connection, by channel.

    ``report_fault`` takes code, text, remedy, and how often.
    """

    bus: CanBus
    nodes: Sequence[SupervisedNode]
    cycles: SyncCycleAssembler
    scheduler: SyncScheduler
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

    def __post_init__(self) -> None:
        for channel in range(len(self.nodes)):
            for code in ("node_lost", "duplicate_node", "emergency"):
                self.conditions.end(channel, code)

    @property
    def _patience_ns(self) -> int:
        return int(HEARTBEATS_MISSED * self.options.heartbeat_ms * 1e6)

    # -- what is received ------------------------------------------------------

    def seen(self, channel: int, now_ns: int) -> None:
        self.nodes[channel].last_seen_ns = now_ns

    def heartbeat(self, channel: int, state: int, now_ns: int) -> None:
        """Take a node's state, or its boot-up."""
        node = self.nodes[channel]
        if state == wire.BOOT_UP:
            if node.boot_ns and now_ns - node.boot_ns < TWO_BOOT_UPS_NS:
                self.duplicate(channel, now_ns, "two boot-ups at once")
            node.boot_ns = now_ns
            node.wants_set_up = True
        # Its first word after the start may still be of the state before.
        node.idle = (
            state in (wire.STATE_STOPPED, wire.STATE_PRE_OPERATIONAL)
            and now_ns - node.started_ns > self._patience_ns // 2
        )

    def emergency(self, channel: int, message: wire.Emergency) -> None:
        """Note an emergency, or the end of all; that node is checked next."""
        self._status_turn, self._status_due_ns = channel, 0
        node = self.nodes[channel]
        if message.code & 0xFF00 == 0:
            node.emergencies.clear()
            self.conditions.end(channel, "emergency")
            return
        node.emergencies.add(message.code)
        text = objects.emergency_text(message.code)
        self.conditions.report(
            channel,
            "emergency",
            f"node {node.number}: {text} (code {message.code:04X}, error register "
            f"{message.register:02X}, maker's bytes {message.detail.hex()})",
            message.code,
        )

    def duplicate(self, channel: int, now_ns: int, sign: str) -> None:
        """Note that two nodes seem to have the same number."""
        node = self.nodes[channel]
        node.duplicate_ns = now_ns
        if not self.conditions.is_raised(channel, "duplicate_node"):
            text = f"node {node.number} seems to be two: {sign}"
            self.conditions.report(channel, "duplicate_node", text)

    def error_frame(self, can_id: int, data: bytes | bytearray, at_ns: int) -> None:
        """Take the controller's report on the state of its bus."""
        error = decode_error(can_id, data)
        if error.bus_off:
            self._bus_off_ns = at_ns
            text = f"{self.bus.name} is off: its controller saw too many errors"
            self.conditions.report(None, "bus_off", text)
        elif error.restarted:
            self.conditions.end(None, "bus_off")
        if error.passive:
            text = f"{self.bus.name} is disturbed: its controller is error passive"
            self.conditions.report(None, "bus_passive", text)
        elif error.active or error.restarted:
            self.conditions.end(None, "bus_passive")
        if error.overflow:
            self.cycles.note_lost_frames()
            self._report_overflow(1)

    # -- between two reads of the bus ------------------------------------------

    def observe(self) -> None:
        """Update presence and losses; sends no request, so that it never waits.

        Raises:
            DeviceError: all nodes are lost.
        """
        now_ns = self.now_ns()
        if now_ns < self._look_due_ns:
            return
        self._look_due_ns = now_ns + LOOK_NS
        self._note_answers(now_ns)
        self._report_losses()
        self._restarted = self._look(now_ns) or self._long_ambiguous(now_ns)
        for channel in range(len(self.nodes)):
            self.cycles.status[channel] = self._status(channel)
        last_ns = max(node.last_seen_ns for node in self.nodes)
        if now_ns - last_ns > self._patience_ns:
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
            period_s = self.options.status_period_s / len(self.nodes)
            self._status_due_ns = now_ns + int(period_s * 1e9)
            self._request_alarms(self._status_turn)
            self._check_settings(self.nodes[self._status_turn])
            self._status_turn = (self._status_turn + 1) % len(self.nodes)

    def _look(self, now_ns: int) -> list[int]:
        """Update presence; return the channels to be set up again."""
        for channel, node in enumerate(self.nodes):
            if now_ns - node.last_seen_ns > self._patience_ns:
                silent_s = (now_ns - node.last_seen_ns) * 1e-9
                if not self.conditions.is_raised(channel, "node_lost"):
                    text = f"node {node.number} has been silent for {silent_s:.1f} s"
                    self.conditions.report(channel, "node_lost", text)
            elif not (node.wants_set_up or node.idle):
                self.conditions.end(channel, "node_lost")
            if now_ns - node.duplicate_ns > DUPLICATE_LASTS_NS:
                self.conditions.end(channel, "duplicate_node")
        return [c for c, n in enumerate(self.nodes) if n.wants_set_up or n.idle]

    def _status(self, channel: int) -> int:
        node = self.nodes[channel]
        is_duplicate = self.conditions.is_raised(channel, "duplicate_node")
        doubtful = STATUS_WARNING * bool(node.warnings or node.emergencies)
        return STATUS_ERROR * (is_duplicate or bool(node.alarms)) | doubtful

    def complaints(self, channel: int, alarms: int, warnings: int) -> None:
        """Report alarms of a node's objects 6503 and 6505."""
        node = self.nodes[channel]
        node.alarms, node.warnings = alarms, warnings
        for code, bits, words in (
            ("encoder_alarm", alarms, objects.alarm_text),
            ("encoder_warning", warnings, objects.warning_text),
        ):
            if bits:
                text = f"node {node.number}: {words(bits)} ({bits:04X})"
                self.conditions.report(channel, code, text, bits)
            else:
                self.conditions.end(channel, code)

    def _long_ambiguous(self, now_ns: int) -> list[int]:
        """Channels to restart with another master's SYNCs, which cannot be paused."""
        ambiguous = self.cycles.ambiguous
        if not ambiguous or self.options.sync != "external":
            self._certain_ns = now_ns
        if now_ns - self._certain_ns < AMBIGUOUS_NS:
            return []
        return [c for c in range(len(self.nodes)) if ambiguous >> c & 1]

    def _note_answers(self, now_ns: int) -> None:
        cycles = self.cycles
        answered, cycles.seen = cycles.seen, 0
        if answered and now_ns - self._bus_off_ns > BACK_ON_BUS_NS:
            self.conditions.end(None, "bus_off")
        for channel, node in enumerate(self.nodes):
            if answered >> channel & 1:
                self.seen(channel, now_ns)
            if n := cycles.duplicates[channel]:
                sign = f"{n} second answers to one SYNC"
                self.duplicate(channel, now_ns, sign)
                self.report_fault(
                    "duplicate_answers",
                    f"node {node.number}: {sign}",
                    "see the alarm duplicate_node",
                    n,
                )
            if node.sdo.surplus:
                node.sdo.surplus = 0
                self.duplicate(channel, now_ns, "two answers to one question")
        cycles.duplicates.clear()

    def _set_up_again(self, channel: int) -> None:
        node = self.nodes[channel]
        sdo, known = node.sdo, node.facts
        try:
            self.bus.send(wire.NMT, wire.nmt_command(wire.PRE_OPERATIONAL, known.node))
            facts = read_facts(sdo, known.node)
            if (facts.counts_per_turn, facts.modulus) != (
                known.counts_per_turn,
                known.modulus,
            ):
                raise DeviceError(
                    f"{sdo.name} restarted with {facts.counts_per_turn} counts per turn"
                    f", it had {known.counts_per_turn}",
                    "if it was replaced, correct the arm file and identify anew",
                )
            code_sequence = self.options.code_sequence
            counts, counted_before = (
                node_facts.counting(code_sequence) for node_facts in (facts, known)
            )
            if counts != counted_before:
                raise DeviceError(
                    f"{sdo.name} counts otherwise or from another place: parameters/"
                    f"offset (objects 6000, 6509) were {counted_before}, are {counts}",
                    "store its preset and settings in it; then confirm the arm",
                )
            if facts.serial != known.serial:
                raise DeviceError(
                    f"{sdo.name} was exchanged: was {known.serial or 'unknown'}, is "
                    f"{facts.serial or 'unknown'}",
                    "if that is right, confirm it",
                )
            if not facts.serial:
                raise DeviceError(
                    f"{sdo.name} was without power, and no serial number shows that "
                    "it is the same",
                    "if it is, confirm it",
                )
            node.settings, forgotten = set_up_node(sdo, facts, self.options)
        except NodeError:
            return  # it stays lost; it is tried again
        self.bus.send(wire.NMT, wire.nmt_command(wire.START, known.node))
        node.wants_set_up = node.idle = False
        node.emergencies.clear()
        node.last_seen_ns = node.started_ns = node.settings_ns = self.now_ns()
        self.conditions.end(channel, "emergency")
        if self.options.sync == "external":
            self.cycles.reset_attribution(1 << channel)
        self._restarted = ()
        self.complaints(channel, facts.alarms, facts.warnings)
        if forgotten:
            self.report_fault(
                "node_restarted",
                f"node {known.node} has restarted; it is set up again and measures",
                "check its power supply; check a known point before measuring on",
                1,
            )

    def _request_alarms(self, channel: int) -> None:
        sdo = self.nodes[channel].sdo
        if self.conditions.is_raised(channel, "node_lost"):
            return
        try:
            alarms = sdo.find_number(objects.ALARMS) or 0
            warnings = sdo.find_number(objects.WARNINGS) or 0
        except NodeError:
            return  # its heartbeat shows whether it is lost
        self.complaints(channel, alarms, warnings)

    def _check_settings(self, node: SupervisedNode) -> None:
        """Compare what the frames of a node mean with how it was set up.

        Raises:
            DeviceError: another master has changed it.
        """
        if node.wants_set_up or node.idle:
            return
        read_ns = self.now_ns()
        try:
            settings = read_settings(node.sdo)
        except NodeError:
            return
        if settings != node.settings:
            changes = settings_text(settings, node.settings)
            raise DeviceError(
                f"{node.sdo.name} was set otherwise by another program: {changes}",
                "let no other program set encoders while the arm measures; check a "
                "known point before measuring on",
                since_ns=node.settings_ns,
            )
        node.settings_ns = read_ns

    def _report_losses(self) -> None:
        """Report losses since the last time, and count them for `health`."""
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
            self.counters[f"missing_node_{self.nodes[channel].number}"] += n
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
        self.report_fault(
            "frames_overflowed",
            f"frames were lost on {self.bus.name} because they were not read in time",
            "lower the rate; give the daemon more of the computer; on SocketCAN let it "
            "keep more: sysctl net.core.rmem_max=4194304",
            n,
        )

    def _report_by_node(
        self, counts: Counter[int], code: str, problem: str, remedy: str
    ) -> None:
        if not counts:
            return
        nodes = ", ".join(
            f"node {self.nodes[channel].number}: {n}"
            for channel, n in sorted(counts.items())
        )
        self.report_fault(code, f"{problem}: {nodes}", remedy, counts.total())
        counts.clear()
