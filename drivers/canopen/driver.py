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
    NodeDiscovery,
    bus_identity,
    set_up_nodes,
)
from traverse.drivers.canopen.frame_dispatcher import FrameDispatcher
from traverse.drivers.canopen.node_watch import Conditions, NodeMonitor
from traverse.drivers.canopen.options import CanOpenOptions
from traverse.drivers.canopen.sdo import NodeSdo
from traverse.drivers.canopen.supervisor import NodeSupervisor
from traverse.drivers.canopen.sync_cycles import SyncCycleAssembler
from traverse.drivers.canopen.sync_source import SyncScheduler
from traverse.drivers.io.can_bus import CanBus
from traverse.protocol.canopen import frames as wire

IDLE_S = 0.05
COALESCE_S = 0.001  # on a fast stream a read collects frames for so long


class CanOpenDriver(Driver):
    """Encoders on one bus; channel i is ``nodes[i]``."""

    options: CanOpenOptions
    options_class = CanOpenOptions

    def _prepare(self) -> None:
        # The thread's own.
        self._conditions = Conditions(self.device, self._delivery_queue.put)
        self._first = True
        self._begin_anew()

    def _begin_anew(self) -> None:
        self._dispatcher: FrameDispatcher | None = None
        self._streams_begun = 0

    # -- in the driver's thread ------------------------------------------------

    def _connect(self) -> None:
        options = self.options
        bus = CanBus(
            options.interface,
            options.channel,
            options.bitrate,
            wake_fd=self._wake_read,
            monotonic_ns=self._now_ns,
            identifiers=wire.identifiers(options.nodes),
        )
        dispatcher = self._dispatcher = FrameDispatcher(
            bus, options.nodes, self._counters
        )
        for node in options.nodes:
            bus.send(wire.NMT, wire.nmt_command(wire.PRE_OPERATIONAL, node))
        discovery = dispatcher.discovery = NodeDiscovery(
            bus, options, self._poll_bus, self._now_ns, self._is_stopping
        )
        discovery.query_all()
        discovery.raise_if_missing()
        discovery.recheck_duplicates()
        dispatcher.discovery = None
        sdos = dispatcher.sdos = {
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
        facts, forgotten = set_up_nodes(sdos, options)
        cycles = dispatcher.cycles = SyncCycleAssembler(
            self.device,
            options.nodes,
            [fact.modulus for fact in facts],
            [fact.position for fact in facts],
            self._delivery_queue.put,
            late_ns=int(options.late_s * 1e9),
        )
        dispatcher.scheduler = SyncScheduler(
            bus, options.sync, self._fault, self._now_ns
        )
        for node in options.nodes:
            bus.send(wire.NMT, wire.nmt_command(wire.START, node))
        now_ns = self._now_ns()
        watch = NodeMonitor(
            options.nodes, options.heartbeat_ms, self._conditions, now_ns
        )
        dispatcher.supervisor = NodeSupervisor(
            bus,
            list(sdos.values()),
            facts,
            cycles,
            watch,
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
            watch.complaints(channel, fact.alarms, fact.warnings)
            if fact.node in discovery.duplicates:
                watch.duplicate(channel, now_ns, "two answers to one question")

    def _serve(self) -> None:
        supervisor = None if self._dispatcher is None else self._dispatcher.supervisor
        while supervisor is not None and not self._stopping:
            self._begin_requested_stream()
            self._poll_bus(IDLE_S)
            supervisor.act()
            self._report_counters()

    def _disconnect(self) -> None:
        if self._dispatcher is not None:
            self._dispatcher.close()
        self._begin_anew()

    def _is_stopping(self) -> bool:
        return self._stopping

    def _poll_bus(self, limit_s: float) -> None:
        """Send a SYNC if it is time, read the bus once, hand over what is finished.

        Also called while a transfer waits for its answer.
        """
        self.heartbeat.beat(ASK_S)
        dispatcher = self._dispatcher
        if dispatcher is None:
            return
        cycles, scheduler = dispatcher.cycles, dispatcher.scheduler
        if cycles is None or scheduler is None:
            dispatcher.read(limit_s)
            return
        limit_s = min(limit_s, scheduler.advance(cycles, dispatcher.read_out))
        if scheduler.is_fast:  # waking for each frame costs more than the frame
            pause_s = min(limit_s, COALESCE_S)
            time.sleep(pause_s)
            limit_s -= pause_s
        dispatcher.read(limit_s)
        cycles.flush(self._now_ns())
        if dispatcher.supervisor is not None:
            dispatcher.supervisor.observe()

    # -- streams ---------------------------------------------------------------

    def _begin_requested_stream(self) -> None:
        if self._streams_begun == (requested := self._streams_requested):
            return
        self._streams_begun = requested
        dispatcher, rate_hz = self._dispatcher, self._rate_hz
        if (
            dispatcher is None
            or dispatcher.scheduler is None
            or dispatcher.cycles is None
        ):
            return
        scheduler, cycles = dispatcher.scheduler, dispatcher.cycles
        scheduler.stop()
        cycles.end(self._now_ns())
        if not rate_hz:
            return
        cycles.restart(self._stream + 1)
        if self.options.sync == "external":  # which cannot be held back to be sure
            cycles.reset_attribution((1 << len(self.options.nodes)) - 1)
        scheduler.start(self._start_stream(rate_hz))
