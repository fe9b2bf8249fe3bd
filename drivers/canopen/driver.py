"""Driver of encoders on a CAN bus that speak CANopen, CiA 301 and CiA 406.

Every node is set up to send its position (object 6004) at each SYNC, which works with
all makers whose manuals were read; nothing is stored in the encoders. A sample has the
instant of its SYNC: the kernel's time stamp of the frame where the interface gives it,
else the moment right after it was sent.

Rests on general knowledge, to be checked against the encoder's manual: how a PDO is
mapped anew (`drivers/canopen/node.py`), warning bit 5 and the makers' own bits
(`protocol/canopen/objects.py`), the device state abort code.
"""

import time
from collections.abc import Callable

from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.driver import ASK_S, Driver
from traverse.drivers.base.values import DeviceUp, StreamStarted
from traverse.drivers.canopen.discovery import (
    ASK_DEVICE_TYPE,
    Roll,
    identity_of,
    set_up_nodes,
)
from traverse.drivers.canopen.frame_dispatcher import Reading
from traverse.drivers.canopen.loss_reports import Losses
from traverse.drivers.canopen.node_watch import Conditions, NodeMonitor
from traverse.drivers.canopen.options import CanOpenOptions
from traverse.drivers.canopen.sdo import NodeSdo
from traverse.drivers.canopen.supervisor import NodeSupervisor
from traverse.drivers.canopen.sync_cycles import Cycles
from traverse.drivers.canopen.sync_source import SyncScheduler
from traverse.drivers.io.can_bus import CanBus
from traverse.protocol.canopen import frames as wire

IDLE_S = 0.05
COALESCE_S = 0.001  # on a fast stream a read takes what so long brings


class CanOpenDriver(Driver):
    """Encoders on one bus; channel i is ``nodes[i]``.

    Args:
        device: id in the configuration.
        delivery_queue: where deliveries go.
        monotonic_ns: the host's clock.
        options: as in `CanOpenOptions`, which has the defaults.
    """

    options = CanOpenOptions

    def __init__(
        self,
        device: str,
        delivery_queue: DeliveryQueue,
        *,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        **options: object,
    ) -> None:
        super().__init__(device, delivery_queue, monotonic_ns)
        self._set = CanOpenOptions.model_validate(options)
        # Written by the service, read by the thread.
        self._rate_hz = 0.0
        self._streams_wanted = 0
        # The thread's own.
        self._conditions = Conditions(device, delivery_queue.put)
        self._first = True
        self._stream = 0
        self._begin_anew()

    def _begin_anew(self) -> None:
        self._reading: Reading | None = None
        self._streams_begun = 0

    def request_stream(self, rate_hz: float) -> None:
        """Send SYNCs at ``rate_hz`` from now on; 0 stops them."""
        self._rate_hz = rate_hz
        self._streams_wanted += 1
        self._wake()

    # -- in the driver's thread ------------------------------------------------

    def _connect(self) -> None:
        wanted = self._set
        bus = CanBus(
            wanted.interface,
            wanted.channel,
            wanted.bitrate,
            wake_fd=self._wake_read,
            monotonic_ns=self._now_ns,
            identifiers=wire.identifiers(wanted.nodes),
        )
        reading = self._reading = Reading(bus, wanted.nodes, self._counters)
        for node in wanted.nodes:
            bus.send(wire.NMT, wire.nmt_command(wire.PRE_OPERATIONAL, node))
        roll = reading.roll = Roll(wanted.nodes)
        roll.call(bus, self._turn, wanted, self._now_ns, self._is_stopping)
        roll.check(bus.name)
        roll.confirm(bus, self._turn, wanted, self._now_ns, self._is_stopping)
        reading.roll = None
        sdos = reading.sdos = {
            node: NodeSdo(
                node,
                bus,
                self._turn,
                stopping=self._is_stopping,
                answer_s=wanted.answer_s,
                tries=wanted.answer_tries,
                monotonic_ns=self._now_ns,
            )
            for node in wanted.nodes
        }
        for node, sdo in sdos.items():
            sdo.expect(ASK_DEVICE_TYPE, roll.asked[node] - roll.answers[node])
        started = set_up_nodes(sdos, wanted)
        cycles = reading.cycles = Cycles(
            self.device,
            wanted.nodes,
            [fact.modulus for fact in started.facts],
            [fact.position for fact in started.facts],
            self._delivery_queue.put,
            late_ns=int(wanted.late_s * 1e9),
        )
        reading.train = SyncScheduler(bus, wanted.sync, self._fault, self._now_ns)
        for node in wanted.nodes:
            bus.send(wire.NMT, wire.nmt_command(wire.START, node))
        now_ns = self._now_ns()
        watch = NodeMonitor(wanted.nodes, wanted.heartbeat_ms, self._conditions, now_ns)
        reading.upkeep = NodeSupervisor(
            bus,
            list(sdos.values()),
            started.facts,
            cycles,
            watch,
            self._conditions,
            wanted,
            self._now_ns,
            self._fault,
            Losses(bus, wanted.nodes, cycles, self._fault, self._counters),
        )
        restarted = started.forgotten and not self._first
        identity = identity_of(started.facts, bus.name, wanted)
        self._tell(DeviceUp(self.device, identity, restarted))
        self._first = False
        for channel, fact in enumerate(started.facts):
            watch.complaints(channel, fact.alarms, fact.warnings)
            if fact.node in roll.doubled:
                watch.duplicate(channel, now_ns, "two answers to one question")

    def _serve(self) -> None:
        upkeep = None if self._reading is None else self._reading.upkeep
        while upkeep is not None and not self._stopping:
            self._begin_wanted_stream()
            self._turn(IDLE_S)
            upkeep.act()
            self._report_counters()

    def _disconnect(self) -> None:
        if self._reading is not None:
            self._reading.close()
        self._begin_anew()

    def _is_stopping(self) -> bool:
        return self._stopping

    def _turn(self, limit_s: float) -> None:
        """Send a SYNC if it is time, read the bus once, hand over what is finished.

        Also called while a transfer waits for its answer.
        """
        self.pulse.beat(ASK_S)
        reading = self._reading
        if reading is None:
            return
        cycles, train = reading.cycles, reading.train
        if cycles is None or train is None:
            reading.read(limit_s)
            return
        limit_s = min(limit_s, train.turn(cycles, reading.read_out))
        if train.is_fast:  # waking for each frame costs more than the frame
            pause_s = min(limit_s, COALESCE_S)
            time.sleep(pause_s)
            limit_s -= pause_s
        reading.read(limit_s)
        cycles.flush(self._now_ns())
        if reading.upkeep is not None:
            reading.upkeep.observe()

    # -- streams ---------------------------------------------------------------

    def _begin_wanted_stream(self) -> None:
        if self._streams_begun == (wanted := self._streams_wanted):
            return
        self._streams_begun = wanted
        reading, rate_hz = self._reading, self._rate_hz
        if reading is None or reading.train is None or reading.cycles is None:
            return
        train, cycles = reading.train, reading.cycles
        train.stop()
        cycles.end(self._now_ns())
        if not rate_hz:
            return
        self._stream += 1
        cycles.restart(self._stream)
        if self._set.sync == "external":  # these SYNCs cannot be held back to be sure
            cycles.trust((1 << len(self._set.nodes)) - 1)
        self._tell(StreamStarted(self.device, self._stream, rate_hz))
        train.start(rate_hz)
