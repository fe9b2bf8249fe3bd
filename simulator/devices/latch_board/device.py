"""A latching controller board on a pty: keys, port, faults, power."""

import secrets
from collections import Counter
from functools import partial
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from traverse.simulator.devices.device import DeviceContext, SimulatedDevice
from traverse.simulator.devices.latch_board import wire
from traverse.simulator.devices.latch_board.board import Board
from traverse.simulator.devices.latch_board.sampler import TickCounter
from traverse.simulator.devices.pty_port import PtyPort
from traverse.simulator.devices.serial_table import SerialTable
from traverse.simulator.devices.table import DeviceTable
from traverse.simulator.devices.wrong_clock import ClockTable, WrongClock
from traverse.simulator.scenario.signals import OutgoingFrame
from traverse.simulator.scenario.truth_log import TruthLog


class DropCounter:
    """Notes successive dropped samples as one."""

    def __init__(self, device: str, notes: TruthLog) -> None:
        self._device, self._notes = device, notes
        self._lived_s = self._stood_s = 0.0
        self._begun_s = self._cause_s = 0.0
        self._n = 0

    def live(self, now_s: float) -> None:
        self._stood_s, self._lived_s = now_s - self._lived_s, now_s

    def count(self, n_dropped: int) -> None:
        if n_dropped and not self._n:
            self._begun_s, self._cause_s = self._lived_s, self._stood_s
        self._n += n_dropped
        if not n_dropped:
            self.finish()

    def finish(self) -> None:
        if self._n:
            self._notes.dropped(self._device, self._n, self._begun_s, self._cause_s)
            self._n = 0


FIRMWARE = (1, 0, 0)
PIECE_S, PIECE_WAIT_S = 0.1, 0.02
MOST_EDGES_AHEAD = 4  # unacknowledged, before fast time waits for the host


class LatchBoardTable(DeviceTable):
    """A controller board on a pty."""

    FAULTS: ClassVar[frozenset[str]] = SerialTable.FAULTS - {"late", "reset"} | {
        "unread"
    }

    port: str = Field(min_length=1)
    tick_rate_hz: int = Field(default=1_000_000, ge=100_000, le=100_000_000)
    max_rate_hz: float = Field(default=10_000.0, gt=0.0, le=10_000.0)
    clock_error_ppm: float = Field(default=0.0, ge=-100_000.0, le=100_000.0)
    clock: ClockTable = ClockTable()
    first_ticks: int = Field(default=0, ge=0, le=2**32 - 1)
    inputs: tuple[Literal["button", "switch"], ...] = ("button", "switch")
    temperatures_c: tuple[float, ...] = Field(default=(20.0,), max_length=16)
    transmit_buffer_bytes: int = Field(default=65_536, ge=1024, le=16_777_216)


class SimulatedLatchBoard(SimulatedDevice):
    """A board on a pty."""

    def __init__(self, table: LatchBoardTable, mounting: DeviceContext) -> None:
        super().__init__(table, mounting, table.inputs)
        self.path = mounting.folder / table.port
        self.where = str(self.path)
        self._table, self._clock = table, mounting.clock
        self._sent: Counter[str] = Counter()  # until the last loss of power
        self._drops = DropCounter(table.id, mounting.notes)
        self._lived_s = 0.0
        self._requests = b""
        self.port: PtyPort | None = None
        self.switch_on(0.0)

    def close(self) -> None:
        if self.port is not None:
            self.port.close()
            self.port = None
            self._requests = b""
            self._sent.update(self._counted())

    @property
    def is_on(self) -> bool:
        return self.port is not None

    @property
    def streaming(self) -> bool:
        return self.port is not None and self.board.streaming

    @property
    def ahead(self) -> bool:
        if self.port is None:
            return False
        return self.port.backlog or len(self.board.edges) > MOST_EDGES_AHEAD

    def readers(self) -> list[int]:
        return [] if self.port is None else self.port.readers()

    def writers(self) -> list[int]:
        return [] if self.port is None else self.port.writers()

    def live(self, now_s: float) -> None:
        self._drops.live(now_s)
        late_s, self._lived_s = self._lived_s, now_s
        if not self.is_there(now_s) or self.port is None:
            return
        # A board does not stop where its program does: what it would have sent
        # meanwhile is sent piece by piece, so that the host can receive it.
        while self.board.streaming and (late_s := late_s + PIECE_S) < now_s:
            self._send(self.board.advance(late_s), late_s)
            self.port.drain(PIECE_WAIT_S)
        self._send(self.board.advance(now_s), now_s)
        if self.port.host_changed():
            self.board.lose_host()
            self._requests = b""
        if self._requests:
            was_streaming = self.board.streaming
            answers = self.board.receive(self._requests)
            if self.board.streaming and not was_streaming:
                self._clock.begin(now_s)
            self._send(answers, now_s)
        # A request that is read now may have been sent after ``now_s``, where the
        # program was held up: it is answered next time, so that no latch is before it.
        self._requests = self.port.read()
        if not self._requests:
            self.port.flush()

    def next_due_s(self, block_s: float) -> float:
        if self.port is None:
            return float("inf")
        if self._requests:
            return self._lived_s
        sample_s = self.board.sampler.next_s()
        return min(self.board.next_due_s(), sample_s + block_s)

    def totals(self) -> dict[str, Any]:
        self._drops.finish()
        counted = Counter(self._sent)
        counted.update(self._counted() if self.is_on else {})
        return {**counted, **super().totals()}

    def _counted(self) -> dict[str, int]:
        return {
            "samples": self.board.sampler.n_samples,
            "tx_dropped": self.board.alarms.tx_dropped,
            "rx_rejected": self.board.rx_rejected,
            "edges": self.board.edges.next_seq,
        }

    def _send(self, frames: list[OutgoingFrame], now_s: float) -> None:
        if self.port is None:
            return
        if self.disturbed.faults:
            script_s, disturb = self._clock.script_s(now_s), self.disturbed.disturb
            frames = [
                OutgoingFrame(frame.is_sample, disturb(frame.data, script_s))
                for frame in frames
            ]
        n_dropped = self.port.write(frames)
        if any(frame.is_sample for frame in frames):
            self._drops.count(n_dropped)
        if n_dropped:
            self.port.write(self.board.count_dropped(n_dropped))

    def switch_on(self, now_s: float) -> None:
        super().switch_on(now_s)
        table, mounting = self._table, self.mounting
        moduli = mounting.encoders.moduli
        identity = wire.Identity(
            board_id=b"SIM"
            + bytes(5)
            + mounting.seed[0].to_bytes(8, "little")[:3]
            + bytes((mounting.seed[1],)),
            firmware=FIRMWARE,
            n_inputs=len(table.inputs),
            n_temperatures=len(table.temperatures_c),
            tick_rate_hz=table.tick_rate_hz,
            max_rate_millihz=round(1000.0 * table.max_rate_hz),
            # Not from the seed: two starts of this program are two power-ups.
            boot_id=secrets.randbits(32),
            bits=tuple(max(1, int(m - 1).bit_length()) for m in moduli),
            moduli=tuple(int(m) for m in moduli),
        )
        ticks = TickCounter(
            table.tick_rate_hz,
            WrongClock(table.clock, table.clock_error_ppm),
            table.first_ticks,
            now_s,
        )
        self.board = Board(
            identity,
            ticks,
            self.wiring,
            temperatures_c=table.temperatures_c,
            power_up_s=now_s,
            on_edge=partial(mounting.notes.edge, self.id),
            warming_c=self._warming_c,
        )
        self.port = PtyPort(self.path, table.transmit_buffer_bytes)

    def _warming_c(self, now_s: float) -> float:
        script_s = np.array(self._clock.script_s(now_s))
        return float(self.mounting.climate.change_c(script_s))
