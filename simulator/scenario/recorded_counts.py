"""Recorded counts: `time_s`, one column `<device>/<channel>` for each channel.

Optional columns `button` and `switch` hold the levels of the inputs, 0 or 1.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.plurals import counted
from traverse.simulator.arm.truth import EncoderSet
from traverse.strict_toml.problems import FileError
from traverse.tables.reading import open_table

INPUTS = ("button", "switch")


@dataclass(frozen=True, slots=True)
class Recording:
    """A recorded stream; times (n,) rise from 0, columns are (n,) each."""

    times_s: Floats
    columns: Mapping[str, Integers]

    @property
    def duration_s(self) -> float:
        return float(self.times_s[-1])

    def input_changes(self) -> Iterator[tuple[float, str, int]]:
        """Yield time, name and new level of each change, beginning from 0."""
        for name in INPUTS:
            level = 0
            for time_s, now in zip(
                self.times_s, self.columns.get(name, ()), strict=False
            ):
                if int(now) != level:
                    level = int(now)
                    yield float(time_s), name, level


@dataclass(frozen=True, slots=True)
class RecordedCounts:
    """The counts of one device from a recording, linear between the rows.

    Attributes:
        times_s: (n,)
        unwrapped: (n, n_channels) counts without wraps.
        moduli: (n_channels,)
        repeat: start again at the end.
    """

    times_s: Floats
    unwrapped: Floats
    moduli: Integers
    repeat: bool

    def leaps_rad(self, encoders: EncoderSet) -> Floats:
        """Return how far its end is from its beginning, (n_channels,)."""
        way, half = self.unwrapped[0] - self.unwrapped[-1], self.moduli // 2
        leaps = np.abs((way + half) % self.moduli - half)
        return np.asarray(2.0 * np.pi * leaps / encoders.counts_per_turn)

    def counts(self, script_s: Floats, noise: np.random.Generator) -> Integers:
        """Return counts (n, n_channels) at script times (n,)."""
        del noise  # a recording has its own
        if self.repeat:
            script_s = script_s % self.times_s[-1]
        between = [np.interp(script_s, self.times_s, c) for c in self.unwrapped.T]
        counts = np.rint(np.stack(between, axis=1)).astype(np.int64)
        wrapped: Integers = counts % self.moduli
        return wrapped


def recorded_counts(
    recording: Recording, names: list[str], moduli: Integers, repeat: bool
) -> RecordedCounts:
    """Select the channels of one device; differences are taken nearest zero."""
    wrapped = np.stack([recording.columns[name] for name in names], axis=1)
    steps = np.diff(wrapped, axis=0)
    steps = (steps + moduli // 2) % moduli - moduli // 2
    unwrapped = np.concatenate([wrapped[:1], wrapped[:1] + np.cumsum(steps, axis=0)])
    return RecordedCounts(
        recording.times_s, unwrapped.astype(np.float64), moduli, repeat
    )


def read_recording(path: Path) -> Recording:
    """Read a table of counts.

    Raises:
        FileError: with file, line and reason; nothing is half-read.
    """
    times_s: list[float] = []
    values: list[list[int]] = []
    with open_table(path) as table:
        time, *channels = table.header
        if time != "time_s":
            expected = "expected time_s, <device>/<channel>, ..."
            table.refuse_header(f"the first column is {time!r}; {expected}")
            table.check()
        for line, (cell, *cells) in table.rows(table.header):
            time_s = table.number(line, time, cell)
            counts = [table.integer(line, count) for count in cells]
            if time_s is not None and times_s and time_s <= times_s[-1]:
                table.refuse(line, f"{cell} is not later than the row before", time)
            for name, text, count in zip(channels, cells, counts, strict=True):
                if count is None or count < 0:
                    table.refuse(
                        line, f"{text!r} is no count; expected 0 or more", name
                    )
            if time_s is not None and None not in counts:
                times_s.append(time_s)
                values.append([count for count in counts if count is not None])
        table.check()
    if len(values) < 2:
        raise FileError(
            path, f"{counted(len(values), 'row')} of counts; needs 2 or more"
        )
    counts_read = np.array(values, dtype=np.int64)
    columns = {name: counts_read[:, column] for column, name in enumerate(channels)}
    return Recording(np.array(times_s) - times_s[0], columns)
