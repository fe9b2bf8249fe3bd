"""Poses of a campaign as arrays, and duplicate rows among them."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from traverse.arrays import Booleans, Floats, Integers


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Probed poses, one a row; NaN where a file had an empty cell.

    Attributes:
        lines: Line of each in the file, or number of the sample in a
            stream, counting from 1, (n_poses,).
        time_s: Since the campaign's start, (n_poses,).
        artefacts: Index of the touched artefact, (n_poses,).
        features: Index into `Campaign.feature_names` of the artefact, (n_poses,).
        angles_rad: Readings, (n_poses, n_joints).
        temperature_c: (n_poses,).
        joint_temperatures_c: (n_poses, n_joints).
        approaches: Sense of the last motion, -1, 0, +1, (n_poses, n_joints).
        speeds_rad_s: (n_poses, n_joints).
        directions: Unit vectors from the ball towards the material, (n_poses, 3).
        force_n: (n_poses,).
        lengths_mm: As read by artefacts that read lengths, (n_poses,).
        tools: Number of `Campaign.tools`, from 1 on; 0 for the arm's own, (n_poses,).
        orientations: Unit quaternions of the instrument's probe in the artefact's frame
            as measured, (n_poses, 4).
    """

    lines: Integers
    time_s: Floats
    artefacts: Integers
    features: Integers
    angles_rad: Floats
    temperature_c: Floats | None = None
    joint_temperatures_c: Floats | None = None
    approaches: Floats | None = None
    speeds_rad_s: Floats | None = None
    directions: Floats | None = None
    force_n: Floats | None = None
    lengths_mm: Floats | None = None
    tools: Integers | None = None
    orientations: Floats | None = None

    @property
    def oriented(self) -> Booleans:
        """Which have a measured orientation, (n_poses,)."""
        if self.orientations is None:
            return np.zeros(len(self), dtype=np.bool_)
        return np.isfinite(self.orientations[:, 0])

    @property
    def mounted(self) -> tuple[int, ...]:
        """Numbers of the tools that orientations were measured with, rising."""
        if self.tools is None:
            return (0,) if np.any(self.oriented) else ()
        return tuple(np.unique(self.tools[self.oriented]).tolist())

    @property
    def touched(self) -> Floats:
        """Artefact, tool and readings of each, (n_poses, 2 + n_joints)."""
        tools = np.zeros(len(self)) if self.tools is None else self.tools
        return np.column_stack([self.artefacts, tools, self.angles_rad])

    @property
    def n_repeated(self) -> int:
        """How many have all readings of an earlier one at the same feature."""
        rows = np.column_stack([self.features, self.touched])
        return len(rows) - len(np.unique(rows, axis=0))

    def __len__(self) -> int:
        return len(self.time_s)

    def part(self, rows: Booleans | Integers | slice) -> "Poses":
        columns: dict[str, Any] = {}
        for field in fields(self):
            column = getattr(self, field.name)
            columns[field.name] = None if column is None else column[rows]
        return Poses(**columns)


_MOST_LINES = 8
# What a table may say of a pose beside what was touched, with which tool, and when.
_OPTIONAL = [field.name for field in fields(Poses)[5:] if field.name != "tools"]
# Instead of empty cells, which would differ from themselves.
_EMPTY = 1e300


def without_copies(poses: Poses, places: Floats) -> tuple[Poses, tuple[str, ...]]:
    """Count rows once that are there several times.

    A row that agrees with an earlier one in every column is a copy. So is one that
    has another name for the same known point, with equal readings: a table of
    measured points numbers its rows. Equal readings of the same feature at
    another time may be a second touch, or a copy: they count, and are reported.

    Args:
        poses: Of a table.
        places: What was touched, as numbers; equal for equal points, (n_poses, n).

    Returns:
        The poses without copies, and what to report.
    """
    touched = np.column_stack([places, poses.touched])
    candidates = _with_equals(touched)
    if len(candidates) == 0:
        return poses, ()
    columns = (getattr(poses, name) for name in _OPTIONAL)
    optional = [
        column.reshape(len(poses), -1)[candidates]
        for column in columns
        if column is not None
    ]
    compared = np.column_stack([touched[candidates], *optional])
    timed = np.column_stack([compared, poses.time_s[candidates]])
    named = np.column_stack([compared, poses.features[candidates].astype(np.float64)])
    of_all, of_rest = _earlier(timed), _earlier(compared)
    renamed = (of_rest >= 0) & (_earlier(named) < 0)
    is_copy = (of_all >= 0) | renamed
    earlier = np.where(of_all >= 0, of_all, of_rest)
    is_repeat = (_earlier(touched[candidates]) >= 0) & ~is_copy
    keep = np.ones(len(poses), dtype=np.bool_)
    keep[candidates[is_copy]] = False
    lines = poses.lines[candidates]
    return poses.part(keep), tuple(_notes(lines, is_copy, earlier, is_repeat))


def _with_equals(rows: Floats) -> Integers:
    """Find the rows that may have an equal, quickly."""
    # A sum by columns is the same for equal rows, which a product of matrices is not.
    factors = np.random.default_rng(0).random((rows.shape[1],))
    keys = np.zeros(len(rows))
    for index, factor in enumerate(factors.tolist()):
        keys += factor * rows[:, index]
    _, places, counts = np.unique(keys, return_inverse=True, return_counts=True)
    return np.flatnonzero(counts[places] > 1)


def _earlier(rows: Floats) -> Integers:
    """Return the first row that equals each, or -1 where that is itself, (n_rows,)."""
    filled = np.where(np.isnan(rows), _EMPTY, rows)
    _, first, places = np.unique(filled, axis=0, return_index=True, return_inverse=True)
    earliest: Integers = first[places.ravel()]
    return np.where(earliest == np.arange(len(rows)), -1, earliest)


def _notes(
    lines: Integers, is_copy: Booleans, earlier: Integers, is_repeat: Booleans
) -> Iterator[str]:
    copies, repeats = np.flatnonzero(is_copy), np.flatnonzero(is_repeat)
    if len(copies):
        shown = _listed([f"{lines[row]} (as {lines[earlier[row]]})" for row in copies])
        yield f"copies of other poses, which count once: {shown}"
    if len(repeats):
        shown = _listed([str(lines[row]) for row in repeats])
        yield (
            "all readings are those of another pose at the same feature, which count "
            f"as touches of their own: {shown}; delete those that are copies"
        )


def _listed(shown: list[str]) -> str:
    more = len(shown) - _MOST_LINES
    text = ", ".join(shown[:_MOST_LINES])
    return f"lines {text} and {more} more" if more > 0 else f"lines {text}"


def evenly(rows: Integers, most: int) -> Integers:
    """Take so many at most, from the first to the last."""
    places = np.linspace(0, len(rows) - 1, min(len(rows), most))
    return rows[places.astype(np.int64)]


def texts(numbers: Floats) -> list[str]:
    """Write numbers as cells, empty for NaN."""
    return ["" if np.isnan(number) else f"{number:.6g}" for number in numbers]
