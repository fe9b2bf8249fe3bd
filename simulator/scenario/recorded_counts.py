"""Recorded counts: `time_s`, one column `<device>/<channel>` per channel.

Optional columns `button` and `switch` hold the levels of the inputs, 0 or 1.
"""

import csv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from traverse.arrays import Floats, Integers
from traverse.plurals import counted
from traverse.strict_toml.files import table_lines
from traverse.strict_toml.problems import FileError, Problem

INPUTS = ("button", "switch")


@dataclass(frozen=True, slots=True)
class Recording:
    """A recorded stream.

    Times (n,) rise from 0, columns are (n,) each.
    """

    times_s: Floats
    columns: Mapping[str, Integers]

    @property
    def duration_s(self) -> float:
        """From the first row to the last."""
        return float(self.times_s[-1])

    def input_changes(self) -> Iterator[tuple[float, str, int]]:
        """Time, name and new level of each change, beginning from 0."""
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
    """The counts of one device out of a recording, linear between the rows.

    Attributes:
        times_s: (n,)
        unwrapped: (n, n_channels) counts without wraps.
        moduli: (n_channels,)
        repeat: Start again at the end.
    """

    times_s: Floats
    unwrapped: Floats
    moduli: Integers
    repeat: bool

    def counts(self, script_s: Floats, noise: np.random.Generator) -> Integers:
        """Counts (n, n_channels) at times (n,) of the script."""
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
    """Take the channels of one device; differences are taken nearest zero."""
    wrapped = np.stack([recording.columns[name] for name in names], axis=1)
    steps = np.diff(wrapped, axis=0)
    steps = (steps + moduli // 2) % moduli - moduli // 2
    unwrapped = np.concatenate([wrapped[:1], wrapped[:1] + np.cumsum(steps, axis=0)])
    return RecordedCounts(
        recording.times_s, unwrapped.astype(np.float64), moduli, repeat
    )


def read_recording(path: Path) -> Recording:
    """Read a CSV file of counts.

    Raises:
        FileError: With file, line and reason; nothing is half-read.
    """
    try:
        with table_lines(path) as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        message = f"cannot be read: {error}; check the path"
        raise FileError(path, message) from error
    header = rows[0] if rows else []
    problems = []
    if header[:1] != ["time_s"] or len(set(header)) != len(header):
        message = f"the header is {header}; expected time_s, <device>/<channel>, ..."
        problems.append(Problem("line 1", message))
    times_s: list[float] = []
    values: list[list[int]] = []
    for number, row in enumerate(rows[1:], start=2):
        try:
            if len(row) != len(header):
                raise ValueError(
                    f"{counted(len(row), 'cell')}, the header has {len(header)}"
                )
            time_s, *counts = float(row[0]), *(int(cell) for cell in row[1:])
            if not np.isfinite(time_s) or (times_s and time_s <= times_s[-1]):
                raise ValueError(f"time_s {row[0]} is not later than the row before")
            if min(counts, default=0) < 0:
                raise ValueError("a count is negative")
        except ValueError as error:
            problems.append(Problem(f"line {number}", str(error)))
        else:
            times_s.append(time_s)
            values.append(counts)
    if not problems and len(values) < 2:
        problems.append(
            Problem("", f"{counted(len(values), 'row')} of counts; needs 2 or more")
        )
    if problems:
        raise FileError(path, problems)
    table = np.array(values, dtype=np.int64)
    columns = {name: table[:, i] for i, name in enumerate(header[1:])}
    return Recording(np.array(times_s) - times_s[0], columns)
