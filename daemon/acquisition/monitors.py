"""Reports on devices: states, late readings, missing temperatures."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from traverse.daemon.acquisition.device import Device
from traverse.daemon.acquisition.joint_devices import JointDevices
from traverse.daemon.acquisition.resampler import Resampler
from traverse.daemon.clock import HostClock
from traverse.daemon.conditions.monitor import ConditionMonitor
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.pipeline import Pipeline
from traverse.daemon.pose.published import PublishedNumbers
from traverse.drivers.base.values import (
    DeviceAlarm,
    DeviceClockState,
    DeviceFault,
    DeviceLost,
    DeviceUp,
)
from traverse.protocol.messages import QualityFlag

MATCH = "correct the arm file, or set the device up for it"


@dataclass(eq=False)
class DeviceStateTracker:
    """Tracks and reports the states of devices.

    Args:
        pipeline: restarted where turns are lost.
        conditions: informed whether a device is present.
        published: names numbers of a device that was wrong for a while.
    """

    clock: HostClock
    devices: JointDevices
    pipeline: Pipeline
    resampler: Resampler
    events: EventLog
    conditions: ConditionMonitor
    published: PublishedNumbers
    changed: Callable[[], None]

    def on_up(self, device: Device, up: DeviceUp) -> None:
        """Record that a device answered, perhaps another than the arm file's."""
        name = device.section.id
        device.identity = up.identity
        device.up_ns = self.clock.monotonic_ns()
        device.temperatures_c = ()  # those of before may have changed meanwhile
        device.problems = []
        if device in self.devices:
            device.problems = self.pipeline.model.mismatches_with(name, up.identity)
            self.pipeline.use_moduli(name, up.identity.moduli_counts)
            self.resampler.on_up(name, up.identity, restarted=up.restarted)
        for problem in device.problems:
            self.events.report(
                "error",
                "device.mismatch",
                problem,
                source=name,
                remedy=MATCH,
            )
        device.reconnects += device.state == "lost"
        device.state = "failed" if device.problems else "ready"
        if up.restarted:
            # Its absolute encoders continue; their turns are a guess.
            self.pipeline.restart(name)
            self.events.report(
                "warning",
                "device.restarted",
                f"{name} has been without power",
                source=name,
                remedy="check a known point before measuring on",
            )
        firmware = f", firmware {up.identity.firmware}" if up.identity.firmware else ""
        if device.problems:
            cause = "; ".join(device.problems)
            self.conditions.doubt("present", name, cause, remedy=MATCH)
        else:
            text = f"{up.identity.name} is there{firmware}"
            self.conditions.establish("present", name, text)
        device.answered.set()
        self.changed()

    def on_lost(self, device: Device, lost: DeviceLost) -> None:
        device.last_loss = lost
        if device in self.devices:
            self.resampler.on_lost(device.section.id)
        if device.state != "starting":
            device.state = "lost"
            name = device.section.id
            reason, data = lost.reason, None
            if lost.since_ns:
                named, data = self.published.between(
                    lost.since_ns,
                    self.clock.monotonic_ns(),
                    QualityFlag.TURNS_UNCERTAIN,
                )
                reason += named
            self.conditions.doubt(
                "present", name, reason, remedy=lost.remedy, data=data
            )
        device.answered.set()
        self.changed()

    def on_alarm(self, device: Device, alarm: DeviceAlarm) -> None:
        source, joint = device.section.id, None
        if alarm.channel is not None:
            joint = self.pipeline.model.joint_of(source, alarm.channel)
            source = f"{source}/{alarm.channel}"
        value = f" (value {alarm.value})" if alarm.value else ""
        text = f"{alarm.text}{value}" if alarm.raised else f"ended: {alarm.text}"
        self.events.change(
            alarm.raised,
            "error",
            f"alarm.{alarm.code}",
            text if joint is None else f"{joint}: {text}",
            source=source,
            remedy=alarm.remedy if alarm.raised else "",
        )

    def on_clock(self, device: Device, clock: DeviceClockState) -> None:
        name = device.section.id
        device.clock_text = text = clock_text(name, clock)
        if not clock.is_certain:  # else once its samples are no longer marked
            device.clock_doubt = text
            self.conditions.mark("device_clock", name, text)
        # Of a line that was laid below 1.5 s the slope is known no better than that.
        known = abs(clock.rate_error) - clock.bound_ns * 1e-9 / SHORTEST_S
        # Once known to be off it stays so, however the bound varies on a busy machine.
        is_known = known > 0.0 or device.has_rate_error
        is_off = is_known and abs(clock.rate_error) > USUAL_RATE_ERROR
        if is_off and not clock.is_certain:
            return  # it may still be learned wrong
        device.has_rate_error = is_off
        self.events.change(
            is_off,
            "warning",
            "device.clock_rate",
            text,
            source=name,
            remedy="nothing, while its times are known well enough; a board with a "
            "crystal instead of a resonator, or the right tick rate, states less"
            if is_off
            else "",
            data={
                "rate_ppm": round(clock.rate_error * 1e6, 1),
                "bound_ms": round(clock.bound_ns * 1e-6, 3),
            },
        )

    def on_fault(self, device: Device, fault: DeviceFault) -> None:
        self.events.report(
            "warning",
            f"device.{fault.code}",
            fault.text,
            source=device.section.id,
            remedy=fault.remedy,
            count=fault.count,
        )


SHORTEST_S = 1.5
USUAL_RATE_ERROR = 5e-4  # five times that of a crystal


def clock_text(name: str, clock: DeviceClockState) -> str:
    ppm = clock.rate_error * 1e6
    rate = (
        f"{abs(ppm):.0f} ppm ({abs(ppm) * 1e-4:.3f} %) {'fast' if ppm > 0 else 'slow'}"
    )
    if not clock.is_certain:
        return (
            f"the clock of {name} is not tied to the computer's, or has stood still or "
            f"jumped; it ran {rate} as far as is known"
        )
    return (
        f"the clock of {name} runs {rate}, which is corrected; its times are known "
        f"within {clock.bound_ns * 1e-6:.2f} ms"
    )


CALM_NS = 1_000_000_000  # without another one it is over

LATE, INCOMPLETE = "device.late", "device.incomplete"
CONDITIONS = {
    LATE: (
        "readings of {device} arrive too late for the samples of {clock}",
        "readings of {device} arrive in time again",
        "lower the rate, use a faster line, or raise assembly.wait_s",
    ),
    INCOMPLETE: (
        "samples lack readings of {device}",
        "samples have all readings of {device} again",
        "see the other events of this device; check its encoders and their line",
    ),
}
"""By code: texts of begin and end, and the remedy."""


@dataclass(eq=False)
class LateReadingMonitor:
    """Reports devices with late or missing readings, at begin and end."""

    resampler: Resampler
    clock: HostClock
    events: EventLog

    def __post_init__(self) -> None:
        self._seen: Counter[tuple[str, str]] = Counter()
        self._last_ns: dict[tuple[str, str], int] = {}

    def check(self) -> None:
        """Compare the counters with those of the last call; call periodically."""
        now_ns = self.clock.monotonic_ns()
        for code, counter in (
            (LATE, self.resampler.late),
            (INCOMPLETE, self.resampler.incomplete),
        ):
            for device, count in counter.items():
                key = (code, device)
                if count > self._seen[key]:
                    self._seen[key] = count
                    self._last_ns[key] = now_ns
                    self._report(code, device, active=True)
                elif now_ns - self._last_ns.get(key, now_ns) > CALM_NS:
                    del self._last_ns[key]
                    self._report(code, device, active=False)

    def _report(self, code: str, device: str, *, active: bool) -> None:
        begun, over, remedy = CONDITIONS[code]
        text = begun if active else over
        self.events.change(
            active,
            "warning",
            code,
            text.format(device=device, clock=self.resampler.clock),
            source=device,
            remedy=remedy if active else "",
        )


PATIENCE_NS = 5_000_000_000  # boards report the temperature every 2 s


@dataclass(eq=False)
class TemperatureMonitor:
    """Feeds the condition of the temperature that effects of the arm need."""

    clock: HostClock
    conditions: ConditionMonitor

    def check(self, model: ArmModel, devices: JointDevices) -> None:
        """Check the devices that read the arm; call with every block."""
        now_ns = self.clock.monotonic_ns()
        for device in devices.devices:
            device.drop_old_temperatures(now_ns)
        if not model.uses_temperature:
            return
        if devices.temperature_c is not None:
            self.conditions.establish("temperature")
            return
        up_ns = max(device.up_ns for device in devices.devices)
        if now_ns - up_ns < PATIENCE_NS:
            return  # it has just connected, its first message is on the way
        names = ", ".join(model.devices)
        self.conditions.doubt(
            "temperature",
            cause=f"{names} has no temperature for the arm's effects, or none that an "
            "arm can have (degrees Fahrenheit?); the reference of "
            f"{model.reference_temperature_c:g} C is taken instead",
        )
