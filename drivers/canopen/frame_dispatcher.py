"""Dispatch the frames of a CANopen bus."""

from collections import Counter
from collections.abc import Mapping, Sequence

from traverse.drivers.canopen.discovery import NodeDiscovery
from traverse.drivers.canopen.sdo import NodeSdo
from traverse.drivers.canopen.supervisor import NodeSupervisor
from traverse.drivers.canopen.sync_cycles import SyncCycleAssembler
from traverse.drivers.canopen.sync_source import SyncScheduler
from traverse.drivers.io.can_bus import FRAMES_LOST, MOST_AT_ONCE, CanBus
from traverse.protocol.canopen import frames as wire
from traverse.protocol.canopen.errors import ERROR_FLAG

MOST_READS = 50  # before a SYNC; a bus transports no more in that time


class FrameDispatcher:
    """Dispatch the frames of one connection; its parts are set as nodes are started."""

    def __init__(
        self, bus: CanBus, nodes: Sequence[int], counters: Counter[str]
    ) -> None:
        self._bus, self._counters = bus, counters
        self._channels = {node: channel for channel, node in enumerate(nodes)}
        self._echoes = False
        self.discovery: NodeDiscovery | None = None
        self.sdos: Mapping[int, NodeSdo] = {}
        self.cycles: SyncCycleAssembler | None = None
        self.scheduler: SyncScheduler | None = None
        self.supervisor: NodeSupervisor | None = None

    def read(self, limit_s: float) -> int:
        """Process what arrives within so many seconds; return the number of frames.

        Raises:
            DeviceError: the bus has disappeared.
        """
        cycles, frames = self.cycles, self._bus.receive(limit_s)
        for can_id, data, time_ns in frames:
            if cycles is None or not cycles.take(can_id, data):
                self._dispatch(can_id, data, time_ns)
        return len(frames)

    def read_out(self) -> None:
        """Process all that has arrived until now.

        Raises:
            DeviceError: the bus has disappeared.
        """
        for _ in range(MOST_READS):
            if self.read(0.0) < MOST_AT_ONCE:
                break

    def close(self) -> None:
        """Send no more SYNCs and close the bus; never raises."""
        if self.scheduler is not None:
            self.scheduler.stop()
        self._bus.close()

    def _dispatch(self, can_id: int, data: bytes | bytearray, time_ns: int) -> None:
        supervisor = self.supervisor
        if can_id == FRAMES_LOST:
            if self.cycles is not None:
                self.cycles.note_lost_frames()
            return
        if can_id & ERROR_FLAG:
            self._counters["error_frames"] += 1
            if supervisor is not None:
                supervisor.error_frame(can_id, data, time_ns)
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
            if self.discovery is not None:
                self.discovery.n_answers[message.node] += 1
            elif message.node in self.sdos:
                self.sdos[message.node].take(message.data)
        if supervisor is None:
            return
        supervisor.watch.seen(channel, time_ns)
        if isinstance(message, wire.Heartbeat):
            supervisor.watch.heartbeat(channel, message.state, time_ns)
        elif isinstance(message, wire.Emergency):
            supervisor.emergency(channel, message)

    def _take_sync(self, time_ns: int) -> None:
        if self.cycles is None or self.scheduler is None:
            return
        if self.scheduler.seen is not None:
            self.cycles.sync(time_ns, self.scheduler.seen.take(time_ns))
        elif self.scheduler.sent is not None and not self._echoes:
            self._counters["foreign_syncs"] += 1
