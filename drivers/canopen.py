"""Driver of encoders on a CAN bus that speak CANopen, CiA 301 and CiA 406.

Every node is set up to send its position (object 6004) at each SYNC, which works with
all makers whose manuals were read; nothing is stored in the encoders. A sample has the
instant of its SYNC: the kernel's time stamp of the frame where the interface gives it,
else the moment right after it was sent.

Rests on general knowledge, to be checked against the encoder's manual: how a PDO is
mapped anew (`drivers/canopen_node.py`), warning bit 5 and the makers' own bits
(`protocol/canopen_objects.py`), the device state abort code.
"""

import time
from collections.abc import Callable

from drivers.can_bus import MOST_AT_ONCE, CanBus
from drivers.can_socket import FRAMES_LOST
from drivers.canopen_cycle import Cycles
from drivers.canopen_losses import Losses
from drivers.canopen_options import CanOpenOptions
from drivers.canopen_sdo import NodeSdo
from drivers.canopen_start import ASK_DEVICE_TYPE, Roll, identity_of, set_up_all
from drivers.canopen_sync import SyncTrain
from drivers.canopen_upkeep import Upkeep
from drivers.canopen_watch import Conditions, NodeWatch
from drivers.crossing import Crossing
from drivers.driver import ASK_S, Driver
from drivers.values import DeviceUp, StreamStarted
from protocol import canopen as wire
from protocol.canopen_errors import ERROR_FLAG

IDLE_S = 0.05
MOST_READS = 50  # before a SYNC; a bus brings no more in the time that they take
COALESCE_S = 0.001  # on a fast stream a read takes what so long brings


class CanOpen(Driver):
    """Encoders on one bus; channel i is ``nodes[i]``.

    Args:
        device: id in the configuration.
        crossing: where deliveries go.
        monotonic_ns: the host's clock.
        options: as in `CanOpenOptions`, which has the defaults.
    """

    options = CanOpenOptions

    def __init__(
        self,
        device: str,
        crossing: Crossing,
        *,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        **options: object,
    ) -> None:
        super().__init__(device, crossing, monotonic_ns)
        self._set = CanOpenOptions.model_validate(options)
        self._channels = {node: number for number, node in enumerate(self._set.nodes)}
        # Written by the service, read by the thread.
        self._rate_hz = 0.0
        self._streams_wanted = 0
        # The thread's own.
        self._conditions = Conditions(device, crossing.put)
        self._first = True
        self._stream = 0
        self._begin_anew()

    def _begin_anew(self) -> None:
        self._bus: CanBus | None = None
        self._sdos: dict[int, NodeSdo] = {}
        self._roll: Roll | None = None
        self._cycles: Cycles | None = None
        self._upkeep: Upkeep | None = None
        self._streams_begun = 0
        self._train: SyncTrain | None = None
        self._echoes = False

    def request_stream(self, rate_hz: float) -> None:
        """Send SYNCs at ``rate_hz`` from now on; 0 stops them."""
        self._rate_hz = rate_hz
        self._streams_wanted += 1
        self._wake()

    # -- in the driver's thread ------------------------------------------------

    def _connect(self) -> None:
        wanted = self._set
        bus = self._bus = CanBus(
            wanted.interface,
            wanted.channel,
            wanted.bitrate,
            wake_fd=self._wake_read,
            monotonic_ns=self._now_ns,
            identifiers=wire.identifiers(wanted.nodes),
        )
        for node in wanted.nodes:
            bus.send(wire.NMT, wire.nmt_command(wire.PRE_OPERATIONAL, node))
        roll = self._roll = Roll(wanted.nodes)
        roll.call(bus, self._turn, wanted, self._now_ns, self._is_stopping)
        roll.check(bus.name)
        roll.confirm(bus, self._turn, wanted, self._now_ns, self._is_stopping)
        self._roll = None
        self._sdos = {
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
        for node, sdo in self._sdos.items():
            sdo.expect(ASK_DEVICE_TYPE, roll.asked[node] - roll.answers[node])
        started = set_up_all(self._sdos, wanted)
        cycles = self._cycles = Cycles(
            self.device,
            wanted.nodes,
            [fact.modulus for fact in started.facts],
            [fact.position for fact in started.facts],
            self._crossing.put,
            late_ns=int(wanted.late_s * 1e9),
        )
        self._train = SyncTrain(bus, wanted.sync, self._fault, self._now_ns)
        for node in wanted.nodes:
            bus.send(wire.NMT, wire.nmt_command(wire.START, node))
        now_ns = self._now_ns()
        watch = NodeWatch(wanted.nodes, wanted.heartbeat_ms, self._conditions, now_ns)
        self._upkeep = Upkeep(
            bus,
            list(self._sdos.values()),
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
        upkeep = self._upkeep
        while upkeep is not None and not self._stopping:
            self._begin_wanted_stream()
            self._turn(IDLE_S)
            upkeep.act()
            self._report_counters()

    def _disconnect(self) -> None:
        if self._train is not None:
            self._train.stop()
        if self._bus is not None:
            self._bus.close()
        self._begin_anew()

    def _is_stopping(self) -> bool:
        return self._stopping

    def _turn(self, limit_s: float) -> None:
        """Send a SYNC if it is time, read the bus once, hand over what is finished.

        Also called while a transfer waits for its answer.
        """
        self.pulse.beat(ASK_S)
        bus, cycles, train = self._bus, self._cycles, self._train
        if bus is None:
            return
        if cycles is None or train is None:
            self._take_frames(bus, cycles, limit_s)
            return
        limit_s = min(limit_s, train.turn(cycles, self._read_out))
        if train.is_fast:  # waking for each frame costs more than the frame
            pause_s = min(limit_s, COALESCE_S)
            time.sleep(pause_s)
            limit_s -= pause_s
        self._take_frames(bus, cycles, limit_s)
        cycles.flush(self._now_ns())
        if self._upkeep is not None:
            self._upkeep.observe()

    def _read_out(self) -> None:
        """Read all that has come until now."""
        if self._bus is not None:
            for _ in range(MOST_READS):
                if self._take_frames(self._bus, self._cycles, 0.0) < MOST_AT_ONCE:
                    break

    def _take_frames(self, bus: CanBus, cycles: Cycles | None, limit_s: float) -> int:
        """Read what has come; how many frames it was."""
        frames = bus.receive(limit_s)
        for can_id, data, time_ns in frames:
            if cycles is None or not cycles.take(can_id, data):
                self._dispatch(can_id, data, time_ns)
        return len(frames)

    def _dispatch(self, can_id: int, data: bytes | bytearray, time_ns: int) -> None:
        upkeep = self._upkeep
        if can_id == FRAMES_LOST:
            if self._cycles is not None:
                self._cycles.lose_track()
            return
        if can_id & ERROR_FLAG:
            self._counters["error_frames"] += 1
            if upkeep is not None:
                upkeep.error_frame(can_id, data, time_ns)
            return
        message = wire.decode(can_id, data)
        if isinstance(message, wire.Sync):
            self._take_sync(time_ns)
            return
        channel = None if message is None else self._channels.get(message.node)
        if message is None or channel is None:
            self._counters["frames_ignored"] += 1
            # Some interfaces give back what is sent: no SYNC is a stranger's there.
            self._echoes |= can_id - wire.SDO_REQUEST in self._channels
            return
        if isinstance(message, wire.SdoAnswer):
            if self._roll is not None:
                self._roll.answers[message.node] += 1
            elif message.node in self._sdos:
                self._sdos[message.node].take(message.data)
        if upkeep is None:
            return
        upkeep.watch.heard(channel, time_ns)
        if isinstance(message, wire.Heartbeat):
            upkeep.watch.heartbeat(channel, message.state, time_ns)
        elif isinstance(message, wire.Emergency):
            upkeep.emergency(channel, message)

    def _take_sync(self, time_ns: int) -> None:
        if self._cycles is None or self._train is None:
            return
        if self._train.seen is not None:
            self._cycles.sync(time_ns, self._train.seen.take(time_ns))
        elif self._train.sent is not None and not self._echoes:
            self._counters["foreign_syncs"] += 1

    # -- streams ---------------------------------------------------------------

    def _begin_wanted_stream(self) -> None:
        if self._streams_begun == (wanted := self._streams_wanted):
            return
        self._streams_begun = wanted
        train, cycles, rate_hz = self._train, self._cycles, self._rate_hz
        if train is None or cycles is None:
            return
        train.stop()
        cycles.end(self._now_ns())
        if not rate_hz:
            return
        self._stream += 1
        cycles.restart(self._stream)
        if self._set.sync == "external":  # these SYNCs cannot be held back to be sure
            cycles.trust((1 << len(self._channels)) - 1)
        self._tell(StreamStarted(self.device, self._stream, rate_hz))
        train.start(rate_hz)
