"""Driver of RLS Orbis and AksIM encoders, each on a serial port of its own.

All are polled at once and answer side by side; a reading belongs to the middle of its
exchange. In the continuous mode they answer by themselves, each by its own clock, and a
reading belongs to the begin of its reply. That an encoder latches then, and that the
bits between position and status are 0, is general knowledge and not confirmed by the
makers' documents; there is no check sum. A reading must therefore be within reach of
the joint.
"""

import contextlib
from collections.abc import Sequence

from traverse.drivers.base.values import (
    STATUS_ERROR,
    STATUS_WARNING,
    DeviceError,
    DeviceTemperatures,
)
from traverse.drivers.polling.alarms import ConditionAlarms
from traverse.drivers.polling.channel import EncoderReading, PolledChannel, ReadError
from traverse.drivers.polling.polled_driver import PolledDriver
from traverse.drivers.rls.line import GARBLED, SILENT, RlsLineGroup, TimedPosition
from traverse.drivers.rls.options import CONDITIONS, RlsOptions
from traverse.protocol import rls

SERIAL_TRIES = 3  # of an encoder that does not state its number
LISTEN_S = 0.02  # so long it must be quiet before the first request


class RlsDriver(PolledDriver[RlsLineGroup]):
    """Encoders on ports of their own; channel i is the one on port i."""

    options: RlsOptions
    options_class = RlsOptions

    def _prepare(self) -> None:
        options = self.options
        self._continuous = options.mode == "continuous"
        self._request = rls.DETAILED if options.detailed else rls.POSITION
        n_ports = len(options.ports)
        self._temperature_ns = round(options.temperature_period_s * 1e9 / n_ports)
        self._in_hand: set[int] = set()
        self._recognised: set[int] = set()  # channels that were missing, by serial
        self._status = ConditionAlarms(
            self.device, self._delivery_queue.put, CONDITIONS
        )
        self._names = {n: f"encoder on {path}" for n, path in enumerate(options.ports)}
        self._temperatures_c: list[float | None] = [None] * n_ports
        self._temperature_due_ns = 0
        self._next_temperature = 0

    # -- opening and closing --------------------------------------------------

    def _open(self) -> tuple[str, Sequence[PolledChannel]]:
        options, layout = self.options, self.options.layout
        group = self._line = RlsLineGroup(
            options, self._ports, self._wake_read, self._now_ns
        )
        self._in_hand.clear()
        for number in group.discard_input(LISTEN_S):
            group.send_setting(number, rls.STOP)  # another left it continuous
        serial_numbers: list[str | None] = [None] * len(group.lines)
        for _ in range(SERIAL_TRIES):
            unknown = [n for n, number in enumerate(serial_numbers) if number is None]
            if not unknown:
                break
            group.exchange(dict.fromkeys(unknown, rls.SERIAL_NUMBER))
            for number in unknown:
                reply = group.lines[number].reply()
                if not isinstance(reply, ReadError):
                    serial_numbers[number] = rls.serial_number(reply)
        self._serials = tuple(number or "" for number in serial_numbers)
        serials = ", ".join(number or "unknown" for number in serial_numbers)
        if self._continuous:
            for number in self._names:
                group.start_continuous(number, self._request, options.period_us)
        per_turn = 1 << layout.bits
        modulus = per_turn
        if layout.turns:
            modulus = min(1 << 32, modulus << rls.TURNS_BITS)
        return f"{len(serial_numbers)} RLS encoders, serial numbers {serials}", [
            PolledChannel(
                *(name, modulus, per_turn, options.max_speed_rad_s), is_checked=False
            )
            for name in self._names.values()
        ]

    def _disconnect(self) -> None:
        if self._line is not None and self._continuous and self._stopping:
            with contextlib.suppress(DeviceError):
                for number in self._names:
                    self._line.send_setting(number, rls.STOP)
        super()._disconnect()

    # -- reading --------------------------------------------------------------

    def _read_channel(self, channel: int) -> EncoderReading | ReadError:
        group = self._open_line
        if self._continuous:
            answer = self._latest_reply(group, channel)
        else:
            if channel not in self._in_hand:
                self._poll_all(group)
            self._in_hand.discard(channel)
            if group.lines[channel].request == rls.SERIAL_NUMBER:
                return self._recognise(channel, group.lines[channel].reply())
            answer = group.lines[channel].answer()
        return (
            answer if isinstance(answer, ReadError) else self._reading(channel, answer)
        )

    def _cycle_is_valid(self) -> bool:
        self._in_hand.clear()
        longest_ns = self._open_line.longest_ns
        self._counters["longest_exchange_us"] = round(longest_ns * 1e-3)
        self._status.report(self._names, self._now_ns())
        return True

    def _jitter_ns(self) -> int:
        group = self._open_line
        if self._continuous:
            return group.lines[0].reply_duration_ns // 2
        return group.usual_ns // 2

    def _poll_all(self, group: RlsLineGroup) -> None:
        """Poll every encoder that is due in this cycle, one for its temperature."""
        now_ns = self._now_ns()
        due = [n for n, c in enumerate(self._channels) if c.due(now_ns)]
        requests = dict.fromkeys(due, self._request)
        if self._temperature_ns and now_ns >= self._temperature_due_ns:
            self._temperature_due_ns = now_ns + self._temperature_ns
            self._next_temperature = (self._next_temperature + 1) % len(self._names)
            if self._next_temperature in requests:
                requests[self._next_temperature] = rls.TEMPERATURE
        missing = frozenset(n for n, c in enumerate(self._channels) if c.missing)
        self._recognised &= missing
        for number in missing - self._recognised & requests.keys():
            if self._serials[number]:
                requests[number] = rls.SERIAL_NUMBER
        group.exchange(requests, missing)
        self._in_hand = set(due)

    def _recognise(self, channel: int, reply: bytes | ReadError) -> ReadError:
        """Accept an encoder that was missing only with its former serial number."""
        if isinstance(reply, ReadError):
            return reply
        before, now = self._serials[channel], rls.serial_number(reply)
        if now is None:
            return GARBLED
        if now != before:
            raise DeviceError(
                f"{self._names[channel]} was exchanged: was {before}, is {now}",
                "if that is right, confirm it",
            )
        self._recognised.add(channel)
        return SILENT  # its next reply counts

    def _wait(self, seconds: float) -> None:
        """Read encoders of the continuous mode while waiting."""
        if self._continuous:
            self._open_line.listen(seconds)
        else:
            super()._wait(seconds)

    def _latest_reply(
        self, group: RlsLineGroup, channel: int
    ) -> TimedPosition | ReadError:
        line = group.lines[channel]
        if self._channels[channel].missing:
            # It may have lost power, and with it the continuous mode.
            group.start_continuous(channel, self._request, self.options.period_us)
        if line.latest is None:
            options = self.options
            timeout_ns = round(options.answer_timeout_s * 1e9)
            patience_ns = 2_000 * options.period_us + timeout_ns
            group.listen_for_reply(channel, patience_ns)
        answer, line.latest = line.latest, None
        return SILENT if answer is None else answer

    def _reading(self, channel: int, answer: TimedPosition) -> EncoderReading:
        position = answer.position
        known = self._channels[channel]
        count = (
            position.turns * known.counts_per_turn + position.count
        ) % known.modulus
        status = STATUS_ERROR * position.error | STATUS_WARNING * position.warning
        codes = [
            *(["encoder_error"] if position.error else []),
            *(["encoder_warning"] if position.warning else []),
        ]
        if position.conditions is not None:
            codes += [
                c for bit, c in rls.CONDITIONS.items() if position.conditions & bit
            ]
        self._status.add(channel, codes)
        if position.temperature_c is not None:
            self._temperatures_c[channel] = position.temperature_c
            temperatures_c = tuple(self._temperatures_c)
            period_ns = self._temperature_ns * len(temperatures_c)
            self._delivery_queue.put(
                DeviceTemperatures(self.device, temperatures_c, period_ns)
            )
        return EncoderReading(count, answer.time_ns, status, answer.bound_ns)
