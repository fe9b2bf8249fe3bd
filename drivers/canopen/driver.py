"""Driver of encoders on a CAN bus that speak CANopen, CiA 301 and CiA 406.

Every node is set up to send its position (object 6004) at each SYNC, which works with
all makers whose manuals were read; nothing is stored in the encoders. A sample has the
instant of its SYNC: the kernel's time stamp of the frame if the interface has it,
else the moment right after it was sent.

Rests on general knowledge, to be checked against the encoder's manual: how a PDO is
mapped anew (`drivers/canopen/node.py`), warning bit 5 and the makers' own bits
(`protocol/canopen/objects.py`), the device state abort code.
"""

import time

from traverse.drivers.base.driver import ASK_S, Driver
from traverse.drivers.base.values import DeviceUp
from traverse.drivers.canopen.discovery import (
    ASK_DEVICE_TYPE,
    JITTER_NS,
    NodeDiscovery,
    bus_identity,
    set_up_nodes,
)
from traverse.drivers.canopen.options import CanOpenOptions
from traverse.drivers.canopen.sdo import NodeSdo
from traverse.drivers.canopen.supervisor import (
    Conditions,
    NodeSupervisor,
    SupervisedNode,
)
from traverse.drivers.canopen.sync_cycles import SyncCycleAssembler
from traverse.drivers.canopen.sync_source import SyncScheduler
from traverse.drivers.io.can_bus import FRAMES_LOST, MOST_AT_ONCE, CanBus
from traverse.protocol.canopen import frames as wire
from traverse.protocol.canopen.errors import ERROR_FLAG

IDLE_S = 0.05
MOST_READS = 50  # before a SYNC; a bus transports no more in that time
COALESCE_S = 0.001  # on a fast stream a read collects frames for so long


class CanOpenDriver(Driver):
    """Encoders on one bus; channel i is ``nodes[i]``."""

    options: CanOpenOptions
    options_class = CanOpenOptions

    def _prepare(self) -> None:
        # The thread's own.
        self._conditions = Conditions(self.device, self._delivery_queue.put)
        self._first = True
        nodes = enumerate(self.options.nodes)
        self._channels = {node: channel for channel, node in nodes}
        self._bus: CanBus | None = None
        self._begin_anew()

    def _begin_anew(self) -> None:
        self._discovery: NodeDiscovery | None = None
        self._sdos: dict[int, NodeSdo] = {}
        self._supervisor: NodeSupervisor | None = None
        self._echoes = False
        self._streams_begun = 0

    # -- in the driver's thread ------------------------------------------------

    def _connect(self) -> None:
        options = self.options
        bus = self._bus = CanBus(
            options.interface,
            options.channel,
            options.bitrate,
            wake_fd=self._wake_read,
            monotonic_ns=self._now_ns,
            identifiers=wire.identifiers(options.nodes),
        )
        for node in options.nodes:
            bus.send(wire.NMT, wire.nmt_command(wire.PRE_OPERATIONAL, node))
        discovery = self._discovery = NodeDiscovery(
            bus, options, self._poll_bus, self._now_ns, self._is_stopping
        )
        discovery.query_all()
        discovery.raise_if_missing()
        discovery.recheck_duplicates()
        self._discovery = None
        sdos = self._sdos = {
            node: NodeSdo(
                node,
                bus,
                self._poll_bus,
                stopping=self._is_stopping,
                answer_s=options.answer_s,
                tries=options.answer_tries,
                monotonic_ns=self._now_ns,
            )
            for node in options.nodes
        }
        for node, sdo in sdos.items():
            sdo.expect(
                ASK_DEVICE_TYPE, discovery.n_requests[node] - discovery.n_answers[node]
            )
        set_up, forgotten = set_up_nodes(sdos, options)
        facts = [node_facts for node_facts, _ in set_up]
        cycles = SyncCycleAssembler(
            self.device,
            options.nodes,
            [fact.modulus for fact in facts],
            [fact.position for fact in facts],
            self._delivery_queue.put,
            late_ns=int(options.late_s * 1e9),
            stamped=options.interface in JITTER_NS,
        )
        for node in options.nodes:
            bus.send(wire.NMT, wire.nmt_command(wire.START, node))
        now_ns = self._now_ns()
        supervisor = self._supervisor = NodeSupervisor(
            bus,
            [
                SupervisedNode(sdo, node_facts, settings, now_ns, now_ns, now_ns)
                for sdo, (node_facts, settings) in zip(
                    sdos.values(), set_up, strict=True
                )
            ],
            cycles,
            SyncScheduler(bus, options.sync, self._fault, self._now_ns),
            self._conditions,
            options,
            self._now_ns,
            self._fault,
            self._counters,
        )
        restarted = forgotten and not self._first
        identity = bus_identity(facts, bus.name, options)
        self._deliver_state(DeviceUp(self.device, identity, restarted))
        self._first = False
        for channel, fact in enumerate(facts):
            supervisor.complaints(channel, fact.alarms, fact.warnings)
            if fact.node in discovery.duplicates:
                supervisor.duplicate(channel, now_ns, "two answers to one question")

    def _serve(self) -> None:
        supervisor = self._supervisor
        while supervisor is not None and not self._stopping:
            if self._streams_begun != (requested := self._streams_requested):
                self._streams_begun = requested
                self._begin_stream(supervisor, self._rate_hz)
            self._poll_bus(IDLE_S)
            supervisor.act()
            self._report_counters()

    def _disconnect(self) -> None:
        if self._supervisor is not None:
            self._supervisor.scheduler.stop()
        if self._bus is not None:
            self._bus.close()
            self._bus = None
        self._begin_anew()

    def _is_stopping(self) -> bool:
        return self._stopping

    def _begin_stream(self, supervisor: NodeSupervisor, rate_hz: float) -> None:
        scheduler, cycles = supervisor.scheduler, supervisor.cycles
        scheduler.stop()
        cycles.end(self._now_ns())
        if not rate_hz:
            return
        cycles.restart(self._stream + 1)
        if self.options.sync == "external":  # which cannot be held back to be sure
            cycles.reset_attribution((1 << len(self.options.nodes)) - 1)
        scheduler.start(self._start_stream(rate_hz))

    # -- frames ----------------------------------------------------------------

    def _poll_bus(self, limit_s: float) -> None:
        """Send a SYNC if it is time, read the bus once, deliver complete sets.

        Also called while a transfer waits for its answer.
        """
        self.heartbeat.beat(ASK_S)
        supervisor = self._supervisor
        if supervisor is None:
            self._read(limit_s)
            return
        cycles, scheduler = supervisor.cycles, supervisor.scheduler
        limit_s = min(limit_s, scheduler.advance(cycles, self._read_out))
        if scheduler.is_fast:  # waking for each frame costs more than the frame
            pause_s = min(limit_s, COALESCE_S)
            time.sleep(pause_s)
            limit_s -= pause_s
        self._read(limit_s)
        cycles.flush(self._now_ns())
        supervisor.observe()

    def _read_out(self) -> None:
        for _ in range(MOST_READS):
            if self._read(0.0) < MOST_AT_ONCE:
                break

    def _read(self, limit_s: float) -> int:
        """Process the frames of a time; return their number."""
        if self._bus is None:
            return 0
        cycles = None if self._supervisor is None else self._supervisor.cycles
        frames = self._bus.receive(limit_s)
        for can_id, data, time_ns in frames:
            if cycles is None or not cycles.take(can_id, data, time_ns):
                self._dispatch(can_id, data, time_ns)
        return len(frames)

    def _dispatch(self, can_id: int, data: bytes | bytearray, time_ns: int) -> None:
        supervisor = self._supervisor
        if can_id == FRAMES_LOST:
            if supervisor is not None:
                supervisor.cycles.note_lost_frames()
            return
        if can_id & ERROR_FLAG:
            self._counters["error_frames"] += 1
            if supervisor is not None:
                supervisor.error_frame(can_id, data, time_ns)
            return
        message = wire.decode(can_id, data)
        if not isinstance(message, wire.Sync):
            self._take(message, can_id, time_ns)
        elif supervisor is not None:
            self._take_sync(supervisor, time_ns)

    def _take(
        self, message: wire.NodeMessage | None, can_id: int, time_ns: int
    ) -> None:
        supervisor = self._supervisor
        channel = None if message is None else self._channels.get(message.node)
        if message is None or channel is None:
            self._counters["frames_ignored"] += 1
            # Some interfaces give back what is sent: no SYNC is a stranger's there.
            self._echoes |= can_id - wire.SDO_REQUEST in self._channels
            return
        if isinstance(message, wire.SdoAnswer):
            if self._discovery is not None:
                self._discovery.n_answers[message.node] += 1
            elif message.node in self._sdos:
                self._sdos[message.node].take(message.data)
        if supervisor is None:
            return
        supervisor.seen(channel, time_ns)
        if isinstance(message, wire.Heartbeat):
            supervisor.heartbeat(channel, message.state, time_ns)
        elif isinstance(message, wire.Emergency):
            supervisor.emergency(channel, message)

    def _take_sync(self, supervisor: NodeSupervisor, time_ns: int) -> None:
        scheduler = supervisor.scheduler
        if scheduler.seen is not None:
            supervisor.cycles.sync(time_ns, scheduler.seen.take(time_ns))
        elif scheduler.sent is not None and not self._echoes:
            self._counters["foreign_syncs"] += 1
