"""Encoders on a CAN bus that speak CANopen, one node for each channel."""

from collections import deque
from typing import Any

import numpy as np

from traverse.simulator.devices.canopen.can_line import (
    CanLine,
    LibraryLine,
    LoopNetwork,
)
from traverse.simulator.devices.canopen.node import CanOpenEncoder, EncoderData
from traverse.simulator.devices.canopen.slcan_adapter import SlcanAdapter
from traverse.simulator.devices.canopen.table import CanOpenTable
from traverse.simulator.devices.device import DeviceContext, SimulatedDevice
from traverse.simulator.scenario.faults import EmcyFault

NMT, SYNC, LSS = 0x000, 0x080, 0x7E5
SDO_REQUEST, EMCY, TPDO1 = 0x600, 0x080, 0x180
BUS_OFF, RESTARTED = 0x040, 0x100  # classes of error frames
ERROR, WARNING = 1, 2  # of a count's status
POSITION_ALARM, LIGHT_WARNING = 1, 2


class CanOpenBus(SimulatedDevice):
    """All encoders on one bus."""

    def __init__(self, table: CanOpenTable, mounting: DeviceContext) -> None:
        super().__init__(table, mounting)
        self._table = table
        self._now_s = 0.0
        self._network = LoopNetwork(self._say)
        counts_per_turn = table.told_counts_per_turn or tuple(
            int(c) for c in mounting.encoders.counts_per_turn
        )
        numbers = table.nodes or tuple(range(1, mounting.n_channels + 1))
        self._encoders = [
            CanOpenEncoder(
                EncoderData(
                    number,
                    1000 + channel,
                    counts_per_turn[channel],
                    table.encoder_turns,
                    int(mounting.encoders.moduli[channel]),
                    table.heartbeat_ms,
                ),
                self._network,
            )
            for channel, number in enumerate(numbers)
        ]
        self._channels = {number: channel for channel, number in enumerate(numbers)}
        self._held: deque[tuple[float, int, bytes]] = deque()
        self._reported: set[int] = set()
        self._n_syncs = 0
        self._line: CanLine | None = None
        self.switch_on(0.0)

    @property
    def is_on(self) -> bool:
        return self._line is not None

    def live(self, now_s: float) -> None:
        self._now_s = now_s
        if not self.is_there(now_s) or (line := self._line) is None:
            return
        self._play_faults(line, now_s)
        for can_id, data in line.receive():
            self._take(can_id, data)
        self._network.live(now_s)
        for encoder in self._encoders:
            while encoder.timer_due_s(now_s) <= now_s:
                self._measure()
                self._say(TPDO1 + encoder.data.number, encoder.timer_pdo())
        while self._held and self._held[0][0] <= now_s:
            line.send(*self._held.popleft()[1:])
        line.flush()

    def next_due_s(self, block_s: float) -> float:
        del block_s  # nothing is gathered
        if self._line is None:
            return float("inf")
        due_s = min(
            self._network.due_s(), *(e.timer_due_s(self._now_s) for e in self._encoders)
        )
        if self._held:
            due_s = min(due_s, self._held[0][0])
        if self._line.poll_s is not None:
            due_s = min(due_s, self._now_s + self._line.poll_s)
        return due_s

    def readers(self) -> list[int]:
        return [] if self._line is None else self._line.readers()

    def writers(self) -> list[int]:
        return [] if self._line is None else self._line.writers()

    def totals(self) -> dict[str, Any]:
        line = self._line
        return {
            "samples": self._n_syncs,
            "tx_dropped": 0 if line is None else line.n_dropped,
            "rx_rejected": 0 if line is None else line.n_rejected,
            **super().totals(),
        }

    def close(self) -> None:
        for encoder in self._encoders:
            encoder.power_down()
        if self._line is not None:
            self._line.close()
            self._line = None

    # -- received by the encoders ------------------------------------------------

    def _take(self, can_id: int, data: bytes) -> None:
        if can_id == SYNC:
            self._sync()
        elif can_id == LSS:
            for encoder in self._encoders:
                if encoder.state:
                    encoder.lss.take(data)
        elif can_id == NMT:
            if len(data) == 2:
                self._network.notify(can_id, bytearray(data), self._now_s)
                for encoder in self._encoders:
                    encoder.obey()
        elif self._is_question(can_id, data):
            self._measure()
            self._network.notify(can_id, bytearray(data), self._now_s)

    def _is_question(self, can_id: int, data: bytes) -> bool:
        channel = self._channels.get(can_id - SDO_REQUEST)
        if channel is None or len(data) != 8:
            return False
        return self._encoders[channel].takes_questions()

    def _sync(self) -> None:
        self.mounting.clock.begin(self._now_s)
        self._measure()
        self._n_syncs += 1
        for channel, encoder in enumerate(self._encoders):
            content = encoder.sync()
            if content is not None:
                self.mounting.notes.reading(
                    self.id, channel, self._now_s, encoder.count, encoder.alarms
                )
                self._say(TPDO1 + encoder.data.number, content)

    def _measure(self) -> None:
        counts, status = self.wiring.latch(np.array([self._now_s]), False)
        script_s = self.mounting.clock.script_s(self._now_s)
        for channel, encoder in enumerate(self._encoders):
            encoder.count = int(counts[0, channel])
            bits = int(status[0, channel])
            encoder.alarms = POSITION_ALARM if bits & ERROR else 0
            encoder.warnings = LIGHT_WARNING if bits & WARNING else 0
            for fault in self.mounting.faults:
                if (
                    isinstance(fault, EmcyFault)
                    and fault.channel == channel
                    and fault.lasts(script_s)
                ):
                    encoder.alarms |= fault.alarms
                    encoder.warnings |= fault.warnings

    def _say(self, can_id: int, data: bytes) -> None:
        """Put a frame of an encoder on the bus, as faults allow."""
        line, channel = self._line, self._channels.get(can_id & 0x7F)
        if line is None:
            return
        script_s = self.mounting.clock.script_s(self._now_s)
        content = self.disturbed.disturb(data, script_s, channel)
        n_times = len(content) // max(1, len(data))
        has_begun = self.mounting.clock.begin_s is not None
        doubled = has_begun and self.mounting.struck("duplicate", self._now_s, channel)
        n_times *= 2 if doubled else 1
        late_s = self.disturbed.delay_s(script_s, channel)
        for _ in range(n_times):
            if late_s:
                self._held.append((self._now_s + late_s, can_id, data))
            else:
                line.send(can_id, data)

    # -- faults ------------------------------------------------------------------

    def switch_on(self, now_s: float) -> None:
        """Join the bus; all encoders begin as delivered."""
        super().switch_on(now_s)
        table = self._table
        if table.port is not None:
            self._line = SlcanAdapter(self.mounting.folder / table.port)
        else:
            self._line = LibraryLine(table.interface, str(table.channel))
        self.where = self._line.where
        for encoder in self._encoders:
            encoder.power_up()

    def _play_faults(self, line: CanLine, now_s: float) -> None:
        if self.mounting.clock.begin_s is None:
            return
        script_s = self.mounting.clock.script_s(now_s)
        for number, fault in enumerate(self.mounting.faults):
            lasts = fault.lasts(script_s)
            if lasts == (number in self._reported):
                continue
            self._reported ^= {number}
            if fault.kind == "bus_off":
                line.bus_off = lasts
                line.send_error(BUS_OFF if lasts else RESTARTED)
            elif isinstance(fault, EmcyFault):
                self._send_emergency(fault, lasts)
            elif fault.kind == "reset":
                self._reset(getattr(fault, "channel", None), lasts)

    def _send_emergency(self, fault: EmcyFault, lasts: bool) -> None:
        content = bytes(8)
        if lasts:
            content = (
                fault.code.to_bytes(2, "little")
                + bytes((fault.error_register,))
                + fault.alarms.to_bytes(2, "little")
                + fault.warnings.to_bytes(2, "little")
                + b"\0"
            )
        encoder = self._encoders[fault.channel]
        if encoder.takes_questions():
            self._say(EMCY + encoder.data.number, content)

    def _reset(self, channel: int | None, lasts: bool) -> None:
        for number, encoder in enumerate(self._encoders):
            if channel in {None, number}:
                if lasts:
                    encoder.power_down()
                else:
                    encoder.power_up()
