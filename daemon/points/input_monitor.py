"""Levels of buttons and switching probes: their polarity, and what they cannot be.

A button that is closed at rest takes its points when it is let go, one that is stuck
takes none, and one that bounces takes several for one press. None of them is a fault of
the device; each shows in how long, or how shortly, its levels last.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from traverse.daemon.config.schema import CaptureSection, InputSection
from traverse.daemon.monitoring.events import EventLog
from traverse.drivers.base.values import CountSamples, DeviceUp, LatchedCounts

REST_NS = 2_000_000_000
"""An input is at rest where it is inactive for so long. Until it was, it is no longer
than this active without a word."""
HELD_NS = 10_000_000_000  # no hand presses a button for so long that does nothing then
BOUNCE_NS = 60_000_000  # no hand presses a button again so soon
ACTIVE, BOUNCED = "input.active_at_rest", "button.bounced"

Input = tuple[str, int]


@dataclass(slots=True)
class _Level:
    """An input's level.

    Attributes:
        is_active: None while unknown.
        since_ns: when it became so; when its device answered.
        has_rested: it was at rest since its device answered.
        released_ns, release_received_ns: of its last release.
    """

    is_active: bool | None
    since_ns: int
    has_rested: bool = False
    released_ns: int | None = None
    release_received_ns: int = 0

    def change(self, is_active: bool, time_ns: int) -> None:
        if is_active == self.is_active or time_ns < self.since_ns:
            return
        was_at_rest = self.is_active is False and time_ns - self.since_ns >= REST_NS
        self.has_rested |= was_at_rest
        self.is_active, self.since_ns = is_active, time_ns


class InputMonitor:
    """Follows the inputs of the configuration."""

    def __init__(self, settings: CaptureSection, events: EventLog) -> None:
        self._events = events
        self._levels: dict[Input, _Level] = {}
        self._reported: set[Input] = set()
        self._inputs: Mapping[Input, InputSection] = {}
        self._masks: Mapping[str, np.uint8] = {}
        self.use(settings)

    def use(self, settings: CaptureSection) -> None:
        """Follow other inputs, or the same with other polarities."""
        before = self._inputs
        self._inputs = {(i.device_id, i.number): i for i in settings.inputs}
        masks: dict[str, np.uint8] = {}
        for (device, number), section in self._inputs.items():
            bit = np.uint8(section.normally_closed << number)
            masks[device] = masks.get(device, np.uint8(0)) | bit
        self._masks = {device: mask for device, mask in masks.items() if mask}
        for which in [*self._levels]:
            if which not in self._inputs:
                self._forget(which)
                continue
            is_turned_round = self._inputs[which].normally_closed
            if is_turned_round != before[which].normally_closed:
                level = self._levels[which]
                level.has_rested = False
                if level.is_active is not None:
                    level.is_active = not level.is_active
        for which in self._inputs.keys() - self._levels.keys():
            self._levels[which] = _Level(None, 0)

    # -- polarity --------------------------------------------------------------

    def turns_round(self, device: str) -> bool:
        """Return whether releases of a device's contacts may be presses."""
        return device in self._masks

    def pressed_samples(self, samples: CountSamples) -> CountSamples:
        """Return samples whose inputs are active while they are pressed or touching."""
        mask = self._masks.get(samples.device)
        return (
            samples if mask is None else replace(samples, inputs=samples.inputs ^ mask)
        )

    def pressed_latch(self, latch: LatchedCounts) -> LatchedCounts:
        """The same of an edge."""
        section = self._inputs.get((latch.device, latch.input or 0))
        if latch.input is None or section is None or not section.normally_closed:
            return latch
        return replace(latch, active=not latch.active)

    # -- levels ----------------------------------------------------------------

    def on_up(self, up: DeviceUp, now_ns: int) -> None:
        """Begin to follow the inputs of a device that answered."""
        for which, section in self._inputs.items():
            device, number = which
            if device == up.device:
                is_active = None
                if up.active_inputs is not None:
                    is_closed = bool(up.active_inputs >> number & 1)
                    is_active = is_closed != section.normally_closed
                self._levels[which] = _Level(is_active, now_ns)

    def on_lost(self, device: str) -> None:
        for which in [*self._levels]:
            if which[0] == device:
                self._forget(which)

    def follow(self, samples: CountSamples) -> None:
        """Note the levels of a device's inputs, by `pressed_samples`."""
        for (device, number), level in self._levels.items():
            if device == samples.device:
                is_active = bool(samples.inputs[-1] >> number & 1)
                level.change(is_active, int(samples.sample_time_ns[-1]))

    def take_edge(self, latch: LatchedCounts, debounce_key: str) -> bool:
        """Note an edge; return whether it counts: a contact may have bounced.

        Args:
            latch: of the edge, by `pressed_latch`.
            debounce_key: of the device's configuration.
        """
        which = latch.device, latch.input or 0
        section, level = self._inputs.get(which), self._levels.get(which)
        if section is None or level is None:
            return True
        level.change(latch.active, latch.sample_time_ns)
        if not latch.active:
            level.released_ns = latch.sample_time_ns
            level.release_received_ns = latch.received_ns
            return True
        if section.trigger != "button" or level.released_ns is None:
            return True
        # By the arrival, too: a clock that is not tied yet may bring edges together.
        open_ns = latch.sample_time_ns - level.released_ns
        received_ns = latch.received_ns - level.release_received_ns
        if not 0 <= open_ns < BOUNCE_NS or received_ns >= BOUNCE_NS:
            return True
        # With other gestures it may be what makes a hold of the press.
        counts = set(section.gesture_actions) != {"click"}
        effect = "it counts as one more press" if counts else "it is no press"
        self._events.report(
            "warning",
            BOUNCED,
            f"button closed again {open_ns * 1e-6:.0f} ms after it opened, as a "
            f"contact that bounces does; {effect}",
            source=f"{latch.device}/{latch.input}",
            remedy=f"raise {debounce_key} of {latch.device}, or exchange the button",
            data={"open_ms": round(open_ns * 1e-6, 3)},
        )
        return counts

    def check(self, now_ns: int, *, is_scan_held: bool) -> None:
        """Report inputs that are active for too long; call it often.

        Args:
            now_ns: the time.
            is_scan_held: a scan runs while a button is pressed.
        """
        for which, level in self._levels.items():
            lasts_ns = now_ns - level.since_ns
            if level.is_active is None:
                continue
            if not level.is_active:
                if lasts_ns >= REST_NS:
                    level.has_rested = True
                    self._end(which)
            elif which not in self._reported:
                section = self._inputs[which]
                is_held = is_scan_held or section.hold or section.trigger == "switch"
                if level.has_rested and is_held:
                    continue
                if lasts_ns >= (HELD_NS if level.has_rested else REST_NS):
                    self._report(which, level)

    def _report(self, which: Input, level: _Level) -> None:
        section = self._inputs[which]
        way = "pressed" if section.trigger == "button" else "touching"
        since = (
            f"for {HELD_NS * 1e-9:.0f} s"
            if level.has_rested
            else f"since {which[0]} is there, or was let go for moments only"
        )
        fix = (
            "take normally_closed out of"
            if section.normally_closed
            else "set normally_closed = true in"
        )
        self._reported.add(which)
        self._events.change(
            True,
            "warning",
            ACTIVE,
            f"{section.trigger} has been {way} {since}",
            source=section.source,
            remedy=f"let it go; if it is at rest, {fix} its [[capture.inputs]], else "
            "points are taken when it is let go; or look for a wire that is cut or "
            "shorted",
        )

    def _end(self, which: Input) -> None:
        if which in self._reported:
            self._reported.remove(which)
            source = f"{which[0]}/{which[1]}"
            text = "the input is at rest"
            self._events.change(False, "warning", ACTIVE, text, source=source)

    def _forget(self, which: Input) -> None:
        del self._levels[which]
        self._end(which)
