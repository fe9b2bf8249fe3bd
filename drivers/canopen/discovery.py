"""Find all nodes of a bus and set them up; failures are reported together."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from traverse.drivers.base.values import (
    DeviceError,
    DeviceNotFoundError,
    DeviceRefusedError,
    Identity,
)
from traverse.drivers.canopen.node import NodeFacts, read_facts, set_up_node
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


class NodeDiscovery:
    """Which nodes answer a request to all."""

    def __init__(self, nodes: Sequence[int]) -> None:
        self._nodes = nodes
        self.n_answers: Counter[int] = Counter()
        self.n_requests: Counter[int] = Counter()

    def query_all(
        self,
        bus: CanBus,
        poll_bus: Callable[[float], None],
        options: CanOpenOptions,
        now_ns: Callable[[], int],
        stopping: Callable[[], bool],
    ) -> None:
        """Repeat the request until all have answered, within the options' limit.

        ``poll_bus`` reads the bus once and counts answers in `n_answers`.
        """
        for _ in range(options.answer_tries):
            for node in self.silent:
                self.n_requests[node] += 1
                bus.send(wire.SDO_REQUEST + node, ASK_DEVICE_TYPE)
            until_ns = now_ns() + int(options.answer_s * 1e9)
            while self.silent and (left_ns := until_ns - now_ns()) > 0:
                if stopping():
                    return
                poll_bus(min(left_ns * 1e-9, 0.01))

    def recheck_duplicates(
        self,
        bus: CanBus,
        poll_bus: Callable[[float], None],
        options: CanOpenOptions,
        now_ns: Callable[[], int],
        stopping: Callable[[], bool],
    ) -> None:
        """Repeat the request to those that answered too often, after a silence.

        A slow node may still answer a request of an earlier connection, or
        while it was starting; that does not make it two. Arguments: see `query_all`.
        """
        if not (doubtful := self.duplicates):
            return

        def answered_within(seconds: float) -> bool:
            before = self.n_answers.total()
            until_ns = now_ns() + int(seconds * 1e9)
            while (left_ns := until_ns - now_ns()) > 0 and not stopping():
                poll_bus(min(left_ns * 1e-9, 0.01))
            return self.n_answers.total() != before

        for _ in range(options.answer_tries):
            if not answered_within(options.answer_s):
                break
        for node in doubtful:
            self.n_answers[node], self.n_requests[node] = 0, 1
            bus.send(wire.SDO_REQUEST + node, ASK_DEVICE_TYPE)
        answered_within(options.answer_s)

    @property
    def silent(self) -> list[int]:
        """Nodes that have not answered."""
        return [node for node in self._nodes if not self.n_answers[node]]

    @property
    def duplicates(self) -> list[int]:
        """Nodes that have answered more often than requested."""
        return [
            node for node in self._nodes if self.n_answers[node] > self.n_requests[node]
        ]

    def raise_if_missing(self, where: str) -> None:
        """Raise DeviceNotFoundError where nodes were silent."""
        silent = self.silent
        if not silent:
            return
        found = [node for node in self._nodes if node not in silent]
        there = f"; nodes {_listed(found)} do" if found else ""
        raise DeviceNotFoundError(
            f"nodes {_listed(silent)} on {where} do not answer{there}",
            "check power and number of these encoders (traverse can scan shows what is "
            "there)"
            if found
            else "check the power of the encoders, the bit rate, and the termination "
            "of the bus (120 ohm at both ends)",
        )


@dataclass(frozen=True, slots=True)
class NodeSetup:
    """All nodes as they were found."""

    facts: tuple[NodeFacts, ...]
    forgotten: bool


def set_up_nodes(sdos: Mapping[int, NodeSdo], options: CanOpenOptions) -> NodeSetup:
    """Read and set up all nodes; they are not started yet.

    Raises:
        DeviceRefusedError: with what is wrong with each.
    """
    facts, failures, forgotten = [], [], False
    for node, sdo in sdos.items():
        try:
            found = read_facts(sdo, node)
            forgotten |= set_up_node(sdo, found, options)
            facts.append(found)
        except DeviceError as error:
            failures.append(error)
    if failures:
        raise DeviceRefusedError(
            "; ".join(str(error) for error in failures), failures[0].remedy
        )
    return NodeSetup(tuple(facts), forgotten)


def bus_identity(
    facts: Sequence[NodeFacts], where: str, options: CanOpenOptions
) -> Identity:
    """Common identity of all nodes, in the form of all drivers."""
    rate_hz = BUS_SHARE * wire.largest_sync_rate_hz(len(facts), options.bitrate)
    if options.interface == "slcan":
        rate_hz = min(rate_hz, SLCAN_FRAMES_HZ / (len(facts) + 1))
    versions = sorted({f"{fact.profile or 0:08X}" for fact in facts})
    return Identity(
        f"CANopen encoders on {where}: {', '.join(fact.name for fact in facts)}",
        f"profile {', '.join(versions)}",
        tuple(fact.modulus for fact in facts),
        0,
        float(int(rate_hz)),
        latches=False,
        counts_per_turn=tuple(fact.counts_per_turn for fact in facts),
        jitter_ns=JITTER_NS.get(options.interface, ADAPTER_JITTER_NS),
        absolute=True,
    )


def _listed(nodes: Sequence[int]) -> str:
    return ", ".join(map(str, nodes))
