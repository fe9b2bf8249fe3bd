"""What holds for all points at once: temperature, age of the identification, alarms."""

from collections import deque
from collections.abc import Iterable

from traverse.daemon.clock import HostClock
from traverse.daemon.config.schema import QualitySection
from traverse.daemon.pose.arm_model import ArmModel
from traverse.protocol.messages import QualityFlag

DAY_S = 86_400.0
Alarm = tuple[str, int, int | str]


class Standing:
    """Keeps the bits that every measurement gets now.

    Args:
        section: of the configuration.
        model: the arm.
        clock: the host's.
    """

    def __init__(
        self, section: QualitySection, model: ArmModel, clock: HostClock
    ) -> None:
        self._clock = clock
        self._temperatures: deque[tuple[int, float]] = deque()
        self._alarms: set[Alarm] = set()
        self.use(section, model)

    def use(self, section: QualitySection, model: ArmModel) -> None:
        """Follow other limits, for another arm; what was seen stays."""
        self._section = section
        self._identified_s = model.identified_s
        self._channels = set(
            zip(model.joint_devices, model.channels.tolist(), strict=True)
        )

    def alarm(
        self, device: str, channel: int | None, code: int | str, raised: bool
    ) -> None:
        """A device's alarm begins or ends."""
        if channel is not None and (device, channel) in self._channels:
            alarm = (device, channel, code)
            (self._alarms.add if raised else self._alarms.discard)(alarm)

    @property
    def temperatures(self) -> tuple[tuple[int, float], ...]:
        """Since when (host monotonic, ns) the arm had which temperature."""
        return tuple(self._temperatures)

    def resume(self, temperatures: Iterable[tuple[int, float]]) -> None:
        """Go on from the `temperatures` of another time."""
        self._temperatures = deque(temperatures)

    def came(self, device: str) -> None:
        """A device has come: it tells its alarms anew."""
        self._alarms = {alarm for alarm in self._alarms if alarm[0] != device}

    def bits(self, temperature_c: float | None) -> int:
        """The flags of now, with the arm at this temperature; None: not known."""
        quality = int(QualityFlag.ENCODER_WARNING) if self._alarms else 0
        if self._is_out_of_band(temperature_c) or self._has_changed(temperature_c):
            quality |= QualityFlag.TEMPERATURE
        if self._is_old():
            quality |= QualityFlag.STALE_IDENTIFICATION
        return int(quality)

    def _is_out_of_band(self, temperature_c: float | None) -> bool:
        low_c = self._section.temperature_low_c
        high_c = self._section.temperature_high_c
        if low_c is None and high_c is None:
            return False
        if temperature_c is None:
            return True
        too_cold = low_c is not None and temperature_c < low_c
        return too_cold or (high_c is not None and temperature_c > high_c)

    def _has_changed(self, temperature_c: float | None) -> bool:
        """Whether it has gone up or down too much within some time."""
        limit_c = self._section.temperature_change_c
        if limit_c is None or temperature_c is None:
            return False
        now_ns = self._clock.monotonic_ns()
        seen = self._temperatures
        if not seen or seen[-1][1] != temperature_c:
            seen.append((now_ns, temperature_c))
        # A temperature holds until the next: the last before that time counts, too.
        oldest_ns = now_ns - int(self._section.temperature_time_s * 1e9)
        while len(seen) > 1 and seen[1][0] <= oldest_ns:
            seen.popleft()
        if len(seen) == 1:
            return False
        values_c = [value_c for _, value_c in seen]
        return max(values_c) - min(values_c) > limit_c

    def _is_old(self) -> bool:
        days = self._section.identification_days
        if days is None:
            return False
        if self._identified_s is None:
            return True  # nobody knows how old it is
        now_s = (self._clock.monotonic_ns() + self._clock.utc_offset_ns()) * 1e-9
        return now_s - self._identified_s > days * DAY_S
