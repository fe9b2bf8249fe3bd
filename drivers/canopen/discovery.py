"""Discovery and set-up of all nodes of a bus; failures are reported together."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from traverse.drivers.base.values import (
    DeviceError,
    DeviceNotFoundError,
    DeviceRefusedError,
    Identity,
)
from traverse.drivers.canopen.node import (
    NodeFacts,
    NodeSettings,
    read_facts,
    set_up_node,
)
from traverse.drivers.canopen.options import CanOpenOptions
from traverse.drivers.canopen.sdo import NodeSdo
from traverse.drivers.io.can_bus import CanBus
from traverse.protocol.canopen import frames as wire

ASK_DEVICE_TYPE = bytes.fromhex("40 00 10 00 00 00 00 00")
BUS_SHARE = 0.8  # for SYNC and positions; the rest is for heartbeats and questions
SLCAN_FRAMES_HZ = 5000.0  # what python-can reads from such an adapter
# From the SYNC's stamp to the latch: the kernel stamps the frame on the bus; adapters
# on USB hand it on a millisecond or so after it was sent.
JITTER_NS = {"socketcan": 50_000}
ADAPTER_JITTER_NS = 1_000_000


@dataclass(eq=False)
class NodeDiscovery:
    """Finds the nodes that answer a request to all.

    ``poll_bus`` reads the bus once and counts answers in `n_answers`.
    """

    bus: CanBus
    options: CanOpenOptions
    poll_bus: Callable[[float], None]
    now_ns: Callable[[], int]
    stopping: Callable[[], bool]

    def __post_init__(self) -> None:
        self._nodes = self.options.nodes
        self.n_answers: Counter[int] = Counter()
        self.n_requests: Counter[int] = Counter()

    def query_all(self) -> None:
        """Repeat the request until all have answered, within the options' limit."""
        for _ in range(self.options.answer_tries):
            for node in self.silent:
                self._ask(node)
            self._poll(until=lambda: not self.silent)

    def recheck_duplicates(self) -> None:
        """Repeat the request, after a silence, to nodes that answered too often.

        A slow node may still answer an earlier connection's request, or one during its
        start.
        """
        if not (doubtful := self.duplicates):
            return
        for _ in range(self.options.answer_tries):
            before = self.n_answers.total()
            self._poll()
            if self.n_answers.total() == before:
                break
        for node in doubtful:
            self.n_answers[node] = self.n_requests[node] = 0
            self._ask(node)
        self._poll()

    def _ask(self, node: int) -> None:
        self.n_requests[node] += 1
        self.bus.send(wire.SDO_REQUEST + node, ASK_DEVICE_TYPE)

    def _poll(self, until: Callable[[], bool] = lambda: False) -> None:
        end_ns = self.now_ns() + int(self.options.answer_s * 1e9)
        while not (until() or self.stopping()) and (left := end_ns - self.now_ns()) > 0:
            self.poll_bus(min(left * 1e-9, 0.01))

    @property
    def silent(self) -> list[int]:
        return [node for node in self._nodes if not self.n_answers[node]]

    @property
    def duplicates(self) -> list[int]:
        """Nodes that have answered more often than requested."""
        return [
            node for node in self._nodes if self.n_answers[node] > self.n_requests[node]
        ]

    def raise_if_missing(self) -> None:
        silent = self.silent
        if not silent:
            return
        answering = [node for node in self._nodes if node not in silent]
        hint = f"; nodes {_listed(answering)} do" if answering else ""
        raise DeviceNotFoundError(
            f"nodes {_listed(silent)} on {self.bus.name} do not answer{hint}",
            "check power and number of these encoders (traverse can scan shows what is "
            "there)"
            if answering
            else "check the power of the encoders, the bit rate, and the termination "
            "of the bus (120 ohm at both ends)",
        )


def set_up_nodes(
    sdos: Mapping[int, NodeSdo], options: CanOpenOptions
) -> tuple[list[tuple[NodeFacts, NodeSettings]], bool]:
    """Read and set up all nodes, without starting them.

    Returns:
        Properties and settings of each, and whether one had lost its settings since
        the last time.

    Raises:
        DeviceRefusedError: lists the faults of each.
    """
    nodes, failures, forgotten = [], [], False
    for node, sdo in sdos.items():
        try:
            node_facts = read_facts(sdo, node)
            settings, was_forgotten = set_up_node(sdo, node_facts, options)
            forgotten |= was_forgotten
            nodes.append((node_facts, settings))
        except DeviceError as error:
            failures.append(error)
    if failures:
        raise DeviceRefusedError(
            "; ".join(str(error) for error in failures), failures[0].remedy
        )
    return nodes, forgotten


def bus_identity(
    facts: Sequence[NodeFacts], where: str, options: CanOpenOptions
) -> Identity:
    rate_hz = BUS_SHARE * wire.largest_sync_rate_hz(len(facts), options.bitrate)
    if options.interface == "slcan":
        rate_hz = min(rate_hz, SLCAN_FRAMES_HZ / (len(facts) + 1))
    versions = sorted({f"{fact.profile or 0:08X}" for fact in facts})
    counting = ", ".join(fact.counting(options.code_sequence) for fact in facts)
    return Identity(
        f"CANopen encoders on {where}: {', '.join(fact.name for fact in facts)}",
        f"profile {', '.join(versions)}; parameters/offsets {counting}",
        tuple(fact.modulus for fact in facts),
        0,
        float(int(rate_hz)),
        latches=False,
        counts_per_turn=tuple(fact.counts_per_turn for fact in facts),
        jitter_ns=JITTER_NS.get(options.interface, ADAPTER_JITTER_NS),
        absolute=True,
        serials=tuple(fact.serial for fact in facts),
    )


def _listed(nodes: Sequence[int]) -> str:
    return ", ".join(map(str, nodes))
