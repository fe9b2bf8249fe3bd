"""Resampling of joints that are read at different instants.

The instants are those of one device's samples, the clock device. Readings of all other
encoders are interpolated linearly in time
(`traverse.daemon.acquisition.interpolation`); so are its own where it reads one encoder
after another. A sample waits for the next readings for a limited time; then the last
ones stand in, and it is flagged.

This module neither reads a clock nor reports events: late readings are counted and
returned.
"""

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Booleans, Floats, Integers
from traverse.daemon.acquisition.interpolation import Interpolated, combined
from traverse.daemon.acquisition.joint_stream import NEVER_NS, JointStream
from traverse.daemon.config.schema import AssemblySection
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.poses import JointCounts
from traverse.daemon.readings.stops import Series
from traverse.drivers.base.values import (
    STATUS_LATE,
    STATUS_MISSING,
    CountSamples,
    Identity,
    LatchedCounts,
)

ResampledSamples = tuple[CountSamples, Floats]
"""Samples with joints as channels, and error bounds of their counts.

The bounds are (n, n_joints, 2), see `Interpolated`.
"""


class Resampler:
    """Makes samples of the whole arm, and counts at single instants.

    Attributes:
        late: by device, samples in which its last readings stand in.
        incomplete: by device, samples that lack its readings.
        dropped: by device, samples dropped for want of its readings.
    """

    def __init__(self, model: ArmModel, settings: AssemblySection) -> None:
        self._settings = settings
        self._wait_ns = int(settings.wait_s * 1e9)
        self.late: Counter[str] = Counter()
        self.incomplete: Counter[str] = Counter()
        self.dropped: Counter[str] = Counter()
        self._waiting: deque[tuple[CountSamples, int]] = deque()
        self._moduli: dict[str, tuple[int, ...]] = {}
        self.use_model(model)

    def use_model(self, model: ArmModel) -> None:
        self.clock = self._settings.clock or model.devices[0]
        self._model = model
        self._wraps = model.wraps_counts(self._moduli)
        self._sources = {}
        self._waiting.clear()
        for device in model.devices:
            joints = np.flatnonzero(np.array(model.joint_devices) == device)
            self._sources[device] = JointStream(
                joints,
                model.channels[joints],
                self._wraps[joints],
                self._wait_ns,
                is_alone=len(model.devices) == 1,
            )

    @property
    def time_bound_ns(self) -> int:
        """Greatest present error of the instants of any device."""
        return max(source.time_bound_ns for source in self._sources.values())

    def time_bound_at_ns(self, instant_ns: int) -> int:
        """How far the instants of any device's readings around one may be off."""
        return max(source.bound_at_ns(instant_ns) for source in self._sources.values())

    def lacks(self) -> dict[str, dict[str, int]]:
        return {
            device: {
                "samples_late": self.late[device],
                "samples_incomplete": self.incomplete[device],
                "samples_held_back": self.dropped[device],
            }
            for device in sorted({*self.late, *self.incomplete, *self.dropped})
        }

    def on_up(self, device: str, identity: Identity, *, restarted: bool) -> None:
        source = self._sources[device]
        source.lost = False
        source.stated_jitter_ns = source.time_bound_ns = identity.jitter_ns
        self._moduli[device] = identity.moduli_counts
        self._wraps = self._model.wraps_counts(self._moduli)
        source.history.wraps_counts = self._wraps[source.joints]
        if restarted:
            source.history.reset()

    def on_lost(self, device: str) -> None:
        self._sources[device].lost = True

    def set_rate(self, device: str, rate_hz: float) -> None:
        self._sources[device].period_ns = int(1e9 / rate_hz) if rate_hz > 0 else 0

    def record(self, samples: CountSamples) -> None:
        self._sources[samples.device].record(samples)

    def add(self, samples: CountSamples, now_ns: int) -> None:
        """Add readings; those of the clock device become samples."""
        self.record(samples)
        if samples.device == self.clock:
            self._waiting.append((samples, now_ns + self._wait_ns))

    def resampled(self, now_ns: int | None = None) -> list[ResampledSamples]:
        """Return samples that are complete, or have waited long enough."""
        made: list[ResampledSamples | None] = []
        while self._waiting:
            block, deadline_ns = self._waiting[0]
            n = len(block.seq)
            if now_ns is None or now_ns < deadline_ns:
                n = int(
                    np.searchsorted(block.sample_time_ns, self._reach_ns(), "right")
                )
            if n:
                made.append(self._resample(block.rows(slice(None, n))))
            if n < len(block.seq):
                self._waiting[0] = (block.rows(slice(n, None)), deadline_ns)
                break
            self._waiting.popleft()
        return [counts for counts in made if counts is not None]

    def at(self, instant_ns: int, latch: LatchedCounts | None) -> JointCounts | None:
        """Return the arm at a host monotonic time; None if later readings are missing.

        ``latch`` has the counts of one device at that instant.
        """
        latched = {}
        instants_ns = np.array([instant_ns])
        for device, source in self._sources.items():
            if latch is not None and latch.device == device and latch.counts:
                latched[device] = source.latched(latch)
            elif source.history.begin_ns <= instant_ns <= source.history.reach_ns:
                latched[device] = source.at(instants_ns)
            else:
                return None
        counts, fractions, status, error_bounds = self._concatenate(latched)
        return JointCounts(
            instant_ns, counts[0], status[0], fractions[0], error_bounds[0]
        )

    def at_instants(self, instants_ns: Integers) -> list[JointCounts]:
        """Return the arm at instants that its samples have passed.

        Readings that are lacking are marked, or the instant is left out, as with a
        sample.
        """
        columns = {
            device: source.at(instants_ns) for device, source in self._sources.items()
        }
        counts, fractions, status, error_bounds = self._concatenate(columns)
        is_short = (status & (STATUS_MISSING | STATUS_LATE)).any(axis=1)
        is_dropped = is_short & (self._settings.policy != "flag")
        return [
            JointCounts(
                int(instants_ns[row]),
                counts[row],
                status[row],
                fractions[row],
                error_bounds[row],
            )
            for row in np.flatnonzero(~is_dropped).tolist()
        ]

    def series_between(self, begin_ns: int, end_ns: int) -> list[Series]:
        """Return the readings of a time that samples are interpolated from."""
        sources = self._sources.values()
        return [it for source in sources for it in source.series(begin_ns, end_ns)]

    def missing_reason(self, instant_ns: int, latch: LatchedCounts | None) -> str:
        """State why `at` returns None."""
        for device, source in self._sources.items():
            if latch is not None and latch.device == device and latch.counts:
                continue
            if source.history.begin_ns == NEVER_NS:
                return f"{device} has not read all its joints yet"
            if instant_ns < source.history.begin_ns:
                return f"it is older than the readings of {device} that are kept"
            if instant_ns > source.history.reach_ns:
                return f"no readings of {device} arrived after it"
        return "nothing is lacking"

    def _reach_ns(self) -> int:
        """Return until when readings are complete or no longer awaited."""
        sources = self._sources.values()
        awaited = [s.history.reach_ns for s in sources if not s.lost]
        return min(awaited, default=NEVER_NS)

    def _resample(self, block: CountSamples) -> ResampledSamples | None:
        """Resample the whole arm at the instants of the clock device's block."""
        begin_ns = max(s.history.begin_ns for s in self._sources.values())
        known = block.sample_time_ns >= begin_ns
        if not known.all():
            for device, source in self._sources.items():
                early = block.sample_time_ns < source.history.begin_ns
                self.dropped[device] += int(early.sum())
            block = block.rows(known)
        if not len(block.seq):
            return None
        interpolated = {
            device: source.at_own_instants(block)
            if device == block.device
            else source.at(block.sample_time_ns)
            for device, source in self._sources.items()
        }
        passed = np.ones(len(block.seq), np.bool_)
        for device, columns in interpolated.items():
            passed &= self._count_shortfalls(device, columns.status)
        counts, fractions, status, error_bounds = self._concatenate(interpolated)
        samples = replace(
            block, counts=counts, status=status, skew_ns=None, fractions=fractions
        )
        if passed.all():
            return samples, error_bounds
        if not passed.any():
            return None
        return samples.rows(passed), error_bounds[passed]

    def _concatenate(
        self, readings: Mapping[str, Interpolated]
    ) -> tuple[NDArray[np.uint32], Floats, NDArray[np.uint8], Floats]:
        """Return counts within their turns, fractions, status and error bounds."""
        order = np.argsort(np.concatenate([s.joints for s in self._sources.values()]))
        columns = combined(list(readings.values()), np.concatenate)
        return (
            (columns.counts[:, order] % self._wraps).astype(np.uint32),
            columns.fractions[:, order],
            columns.status[:, order],
            columns.error_bounds_counts[:, order],
        )

    def _count_shortfalls(self, device: str, status: NDArray[np.uint8]) -> Booleans:
        """Count a device's shortfalls; return which samples (n,) to pass on."""
        joined = np.bitwise_or.reduce(status, axis=1)
        missing = (joined & STATUS_MISSING) != 0
        late = ((joined & STATUS_LATE) != 0) & ~missing
        self.incomplete[device] += int(missing.sum())
        self.late[device] += int(late.sum())
        if self._settings.policy == "flag":
            return np.ones(len(joined), np.bool_)
        self.dropped[device] += int((missing | late).sum())
        return np.asarray(~(missing | late))
