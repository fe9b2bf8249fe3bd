"""CANopen nodes for the command line: discovery, presets; no thread."""

import time
from dataclasses import dataclass, field
from typing import Self

from traverse.drivers.base.values import DeviceError, DeviceNotFoundError
from traverse.drivers.canopen.discovery import ASK_DEVICE_TYPE
from traverse.drivers.canopen.node import NodeFacts, read_facts
from traverse.drivers.canopen.sdo import NodeSdo
from traverse.drivers.io.can_bus import CanBus
from traverse.protocol.canopen import frames as wire
from traverse.protocol.canopen import objects

TRIES = 3
STORE_S = 2.0  # writing to its memory takes an encoder longer than an answer may


@dataclass(slots=True)
class NodeActivity:
    """Frames that a node sent without a request, and its last heartbeat's state."""

    answers: int = 0
    state: int | None = None
    emergencies: list[int] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class FoundNode:
    """A node that answers.

    Attributes:
        device_type: object 1000, None if it is not reported.
        facts: of an encoder; None for another device.
        problem: why facts are missing.
    """

    node: int
    heard: NodeActivity
    device_type: int | None
    facts: NodeFacts | None
    problem: str


class Commissioning:
    """An open bus and requests to its nodes; a context manager.

    Raises:
        DeviceNotFoundError: the bus cannot be opened.
    """

    def __init__(
        self, interface: str, channel: str, bit_rate: int, answer_s: float
    ) -> None:
        self._bus = CanBus(interface, channel, bit_rate)
        self._answer_s = answer_s
        self._sdos: dict[int, NodeSdo] = {}
        self._heard: dict[int, NodeActivity] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self._bus.close()

    @property
    def name(self) -> str:
        return self._bus.name

    def scan(self) -> list[FoundNode]:
        """Find all nodes that answer; changes nothing.

        Raises:
            DeviceNotFoundError: none does.
        """
        for node in range(wire.FIRST_NODE, wire.LAST_NODE + 1):
            self._bus.send(wire.SDO_REQUEST + node, ASK_DEVICE_TYPE)
            self._turn(0.0005)
        until_s = time.monotonic() + self._answer_s
        while (left_s := until_s - time.monotonic()) > 0:
            self._turn(left_s)
        answering = sorted(n for n, activity in self._heard.items() if activity.answers)
        if not answering:
            raise DeviceNotFoundError(
                f"no node answers on {self.name}{self._only_heard()}",
                "check the power of the encoders, the bit rate, and the termination of "
                "the bus (120 ohm at both ends)",
            )
        return [self._describe(node) for node in answering]

    def facts(self, node: int) -> NodeFacts:
        """Read the properties of an encoder.

        Raises:
            DeviceError: it does not answer, or is no encoder.
        """
        return read_facts(self._sdo(node), node)

    def preset(self, node: int, value: int, store: bool) -> int:
        """Preset the present position to ``value``; return the reported one.

        Raises:
            DeviceError: it does not answer, or refuses.
        """
        sdo = self._sdo(node)
        sdo.write(objects.PRESET, 0, value, 4)
        if store:
            sdo.RESPONSE_TIMEOUT = STORE_S
            sdo.MAX_RETRIES = 1
            sdo.write_bytes(objects.STORE, 1, objects.SAVE)
            sdo.RESPONSE_TIMEOUT = self._answer_s
            sdo.MAX_RETRIES = TRIES
        return sdo.read_number(objects.POSITION_VALUE)

    def _describe(self, node: int) -> FoundNode:
        activity, sdo = self._heard[node], self._sdo(node)
        kind = None
        try:
            kind = sdo.read_number(objects.DEVICE_TYPE)
            facts = read_facts(sdo, node)
        except DeviceError as error:
            return FoundNode(node, activity, kind, None, str(error))
        return FoundNode(node, activity, kind, facts, "")

    def _sdo(self, node: int) -> NodeSdo:
        if node not in self._sdos:
            self._sdos[node] = NodeSdo(
                node,
                self._bus,
                self._turn,
                stopping=lambda: False,
                answer_s=self._answer_s,
                tries=TRIES,
            )
        return self._sdos[node]

    def _turn(self, limit_s: float) -> None:
        for can_id, data, _ in self._bus.receive(limit_s):
            message = wire.decode(can_id, data)
            if message is None or isinstance(message, wire.Sync):
                continue
            activity = self._heard.setdefault(message.node, NodeActivity())
            if isinstance(message, wire.Heartbeat):
                activity.state = message.state
            elif isinstance(message, wire.Emergency):
                activity.emergencies.append(message.code)
            elif isinstance(message, wire.SdoAnswer):
                if message.node in self._sdos:
                    self._sdos[message.node].take(message.data)
                else:
                    activity.answers += 1

    def _only_heard(self) -> str:
        if not self._heard:
            return ""
        return f", although frames were received from nodes {sorted(self._heard)}"
