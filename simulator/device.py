"""One device of the simulation: a board, its port, its faults, its power."""

import secrets
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from simulator import wire
from simulator.board import Board
from simulator.climate import ClimateTable
from simulator.config import DeviceTable
from simulator.edges import LatchedEdge
from simulator.encoder import EncoderSet
from simulator.faults import DisturbedLine, EncoderFault, Fault
from simulator.latched import Frame
from simulator.pty_port import PtyPort
from simulator.script import Script, ScriptEvent
from simulator.ticks import TickCounter
from simulator.wiring import CountSource, ScriptClock, Wiring

FIRMWARE = (1, 0, 0)
OnEdge = Callable[[str, int, LatchedEdge, ScriptEvent | None], None]


class Device:
    """A board on a pty.

    Args:
        table: Its configuration.
        path: Of its port.
        encoders: Wired to it.
        source: Of their counts.
        script: What happens to its inputs.
        clock: When the script begins.
        faults: That concern it.
        seed: Of this device.
        on_edge: Told of every edge.
        climate: What its temperature sensors feel.
    """

    def __init__(
        self,
        table: DeviceTable,
        path: Path,
        *,
        encoders: EncoderSet,
        source: CountSource,
        script: Script,
        clock: ScriptClock,
        faults: tuple[Fault, ...],
        seed: tuple[int, int],
        on_edge: OnEdge,
        climate: ClimateTable,
    ) -> None:
        self.id = table.id
        self.line = DisturbedLine(
            tuple(f for f in faults if not isinstance(f, EncoderFault)), seed[0]
        )
        self.path = path
        self._table, self._encoders = table, encoders
        self._source, self._script, self._clock = source, script, clock
        self._faults, self._seed, self._on_edge = faults, seed, on_edge
        self._climate = climate
        self._sent_before = {
            "samples": 0,
            "tx_dropped": 0,
            "rx_rejected": 0,
            "edges": 0,
        }
        self.n_power_ups = 0
        self.port: PtyPort | None = None
        self._power_up(0.0)

    def close(self) -> None:
        """Take the port away."""
        if self.port is not None:
            self.port.close()

    def live(self, now_s: float) -> None:
        """Do all that is due, and answer the host."""
        if self._switch_power(now_s) or self.port is None:
            return
        self._send(self.board.advance(now_s), now_s)
        if self.port.host_changed():
            self.board.lose_host()
        received = self.port.read()
        if received:
            was_streaming = self.board.streaming
            answers = self.board.receive(received)
            if self.board.streaming and not was_streaming:
                self._clock.begin(now_s)
            self._send(answers, now_s)
        else:
            self.port.flush()

    def next_due_s(self, block_s: float) -> float:
        """When to call `live` next, samples gathered in blocks."""
        if self.port is None:
            return float("inf")
        sample_s = self.board.sampler.next_s()
        return min(self.board.next_due_s(), sample_s + block_s)

    def totals(self) -> dict[str, Any]:
        """What came of it all, over all power-ups."""
        here = self._counted()
        totals = {key: here[key] + self._sent_before[key] for key in here}
        return {
            **totals,
            "power_ups": self.n_power_ups,
            "faults": asdict(self.line.counts),
        }

    def _counted(self) -> dict[str, int]:
        return {
            "samples": self.board.sampler.n_samples,
            "tx_dropped": self.board.alarms.tx_dropped,
            "rx_rejected": self.board.rx_rejected,
            "edges": self.board.edges.next_seq,
        }

    def _send(self, frames: list[Frame], now_s: float) -> None:
        if self.port is None:
            return
        if self.line.faults:
            script_s = self._clock.script_s(now_s)
            frames = [
                Frame(frame.is_sample, self.line.disturb(frame.data, script_s))
                for frame in frames
            ]
        n_dropped = self.port.write(frames)
        if n_dropped:
            self.port.write(self.board.count_dropped(n_dropped))

    def _switch_power(self, now_s: float) -> bool:
        """Go away and come back as the faults say; True while away."""
        script_s = self._clock.script_s(now_s)
        begun = self._clock.begin_s is not None
        away = begun and any(
            fault.kind == "gone" and fault.lasts(script_s) for fault in self._faults
        )
        if away and self.port is not None:
            self.port.close()
            self.port = None
        elif not away and self.port is None:
            self._sent_before = {
                key: value + self._sent_before[key]
                for key, value in self._counted().items()
            }
            self._power_up(now_s)
        return away

    def _power_up(self, now_s: float) -> None:
        table, moduli = self._table, self._encoders.moduli
        self.n_power_ups += 1
        self.wiring = Wiring(
            self._source,
            self._script,
            self._clock,
            inputs=table.inputs,
            faults=[f for f in self._faults if isinstance(f, EncoderFault)],
            moduli=moduli,
            seed=(*self._seed, self.n_power_ups),
            from_script_s=self._clock.script_s(now_s),
        )
        identity = wire.Identity(
            board_id=b"SIM"
            + bytes(5)
            + self._seed[0].to_bytes(8, "little")[:3]
            + bytes((self._seed[1],)),
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
            table.tick_rate_hz, table.clock_error_ppm, table.first_ticks, now_s
        )
        self.board = Board(
            identity,
            ticks,
            self.wiring,
            temperatures_c=table.temperatures_c,
            power_up_s=now_s,
            on_edge=self._note_edge,
            warming_c=self._warming_c,
        )
        self.port = PtyPort(self.path, table.transmit_buffer_bytes)

    def _warming_c(self, now_s: float) -> float:
        script_s = np.array(self._clock.script_s(now_s))
        return float(self._climate.change_c(script_s))

    def _note_edge(self, seq: int, edge: LatchedEdge) -> None:
        event = self.wiring.event_at(edge.time_s, edge.input_number)
        self._on_edge(self.id, seq, edge, event)
