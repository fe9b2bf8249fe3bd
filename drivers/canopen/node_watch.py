"""How the nodes are: who lives, who has restarted, who complains.

A node is alive while anything of it is received; its heartbeat ensures that without
SYNCs. Lasting conditions are reported as alarms that begin and end.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from traverse.drivers.base.alarms import Alarms
from traverse.drivers.base.values import STATUS_ERROR, STATUS_WARNING
from traverse.protocol.canopen import frames as wire
from traverse.protocol.canopen import objects

HEARTBEATS_MISSED = 3.5  # in a row, before a node counts as lost
TWO_BOOT_UPS_NS = 100_000_000  # closer together than one node can boot twice
DUPLICATE_LASTS_NS = 5_000_000_000  # after the last sign of it

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
class _Node:
    """One node.

    Attributes:
        heard_ns: when anything of it was received last.
        started_ns: when it was commanded to be operational.
        boot_ns: its last boot-up; 0 for none.
        duplicate_ns: when it last seemed to be two.
        wants_set_up: it has restarted and lost its settings.
        idle: it lives, but is not operational.
        emergencies: codes that have begun.
    """

    number: int
    last_seen_ns: int
    started_ns: int
    boot_ns: int = 0
    duplicate_ns: int = 0
    wants_set_up: bool = False
    idle: bool = False
    alarms: int = 0
    warnings: int = 0
    emergencies: set[int] = field(default_factory=set)


class NodeMonitor:
    """Follows all nodes of a bus, by channel."""

    def __init__(
        self,
        nodes: Sequence[int],
        heartbeat_ms: int,
        conditions: Conditions,
        now_ns: int,
    ) -> None:
        self._nodes = [_Node(number, now_ns, now_ns) for number in nodes]
        self._patience_ns = int(HEARTBEATS_MISSED * heartbeat_ms * 1e6)
        self._conditions = conditions
        for channel in range(len(nodes)):
            for code in ("node_lost", "duplicate_node", "emergency"):
                conditions.end(channel, code)

    def seen(self, channel: int, now_ns: int) -> None:
        """Something of a node was received."""
        self._nodes[channel].last_seen_ns = now_ns

    def heartbeat(self, channel: int, state: int, now_ns: int) -> None:
        """A node reports its state, or that it has just started."""
        node = self._nodes[channel]
        node.last_seen_ns = now_ns
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
        """An error of a node begins, or all are over."""
        node = self._nodes[channel]
        if message.code & 0xFF00 == 0:
            node.emergencies.clear()
            self._conditions.end(channel, "emergency")
            return
        node.emergencies.add(message.code)
        text = objects.emergency_text(message.code)
        self._conditions.report(
            channel,
            "emergency",
            f"node {node.number}: {text} (code {message.code:04X}, error register "
            f"{message.register:02X}, maker's bytes {message.detail.hex()})",
            message.code,
        )

    def duplicate(self, channel: int, now_ns: int, sign: str) -> None:
        """Two nodes seem to have the same number."""
        node = self._nodes[channel]
        node.duplicate_ns = now_ns
        if not self._conditions.is_raised(channel, "duplicate_node"):
            self._conditions.report(
                channel, "duplicate_node", f"node {node.number} seems to be two: {sign}"
            )

    def complaints(self, channel: int, alarms: int, warnings: int) -> None:
        """Alarms of a node's objects 6503 and 6505."""
        node = self._nodes[channel]
        node.alarms, node.warnings = alarms, warnings
        for code, bits, words in (
            ("encoder_alarm", alarms, objects.alarm_text),
            ("encoder_warning", warnings, objects.warning_text),
        ):
            if bits:
                text = f"node {node.number}: {words(bits)} ({bits:04X})"
                self._conditions.report(channel, code, text, bits)
            else:
                self._conditions.end(channel, code)

    def look(self, now_ns: int) -> list[int]:
        """See who is lost or back; the channels that are to be set up again."""
        for channel, node in enumerate(self._nodes):
            if now_ns - node.last_seen_ns > self._patience_ns:
                silent_s = (now_ns - node.last_seen_ns) * 1e-9
                if not self._conditions.is_raised(channel, "node_lost"):
                    self._conditions.report(
                        channel,
                        "node_lost",
                        f"node {node.number} has been silent for {silent_s:.1f} s",
                    )
            elif not (node.wants_set_up or node.idle):
                self._conditions.end(channel, "node_lost")
            if now_ns - node.duplicate_ns > DUPLICATE_LASTS_NS:
                self._conditions.end(channel, "duplicate_node")
        return [c for c, n in enumerate(self._nodes) if n.wants_set_up or n.idle]

    def mark_set_up(self, channel: int, now_ns: int) -> None:
        """A node has been set up and started again."""
        node = self._nodes[channel]
        node.wants_set_up = node.idle = False
        node.emergencies.clear()
        node.last_seen_ns = node.started_ns = now_ns
        self._conditions.end(channel, "emergency")

    def all_lost(self, now_ns: int) -> bool:
        """Whether all nodes have been silent for the time after which one is lost."""
        last_ns = max(node.last_seen_ns for node in self._nodes)
        return now_ns - last_ns > self._patience_ns

    def status(self, channel: int) -> int:
        """Status bits of its samples."""
        node = self._nodes[channel]
        bad = STATUS_ERROR * bool(node.alarms)
        doubtful = STATUS_WARNING * bool(node.warnings or node.emergencies)
        both = self._conditions.is_raised(channel, "duplicate_node")
        return bad | doubtful | STATUS_ERROR * both
