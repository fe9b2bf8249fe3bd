"""Duplicate rows of a table."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from traverse.arrays import Booleans, Floats, Integers

if TYPE_CHECKING:
    from traverse.lab.campaign.campaign import Poses

_MOST_LINES = 8
# Instead of empty cells, which would differ from themselves.
_EMPTY = 1e300


def without_copies(poses: "Poses", places: Floats) -> tuple["Poses", tuple[str, ...]]:
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
    of = poses.artefacts if poses.tools is None else (poses.artefacts, poses.tools)
    touched = np.column_stack(
        [np.transpose(of).astype(np.float64), places, poses.angles_rad]
    )
    candidates = _with_equals(touched)
    if len(candidates) == 0:
        return poses, ()
    optional = [
        column.reshape(len(poses), -1)[candidates]
        for column in (
            poses.temperature_c,
            poses.joint_temperatures_c,
            poses.approaches,
            poses.speeds_rad_s,
            poses.directions,
            poses.force_n,
            poses.lengths_mm,
            poses.orientations,
        )
        if column is not None
    ]
    rest = np.column_stack([touched[candidates], *optional])
    timed = np.column_stack([rest, poses.time_s[candidates]])
    named = np.column_stack([rest, poses.features[candidates].astype(np.float64)])
    of_all, of_rest = _earlier(timed), _earlier(rest)
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
    for at, factor in enumerate(factors.tolist()):
        keys += factor * rows[:, at]
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
        shown = _listed([f"{lines[at]} (as {lines[earlier[at]]})" for at in copies])
        yield f"copies of other poses, which count once: {shown}"
    if len(repeats):
        shown = _listed([str(lines[at]) for at in repeats])
        yield (
            "all readings are those of another pose at the same feature, which count "
            f"as touches of their own: {shown}; delete those that are copies"
        )


def _listed(shown: list[str]) -> str:
    more = len(shown) - _MOST_LINES
    text = ", ".join(shown[:_MOST_LINES])
    return f"lines {text} and {more} more" if more > 0 else f"lines {text}"
