"""Poses that were not measured anew: they carry nothing, but count."""

from traverse.lab.outcomes.base import Established, Finding, doubt
from traverse.plurals import counted

# Part of the poses that may be second presses in one posture.
_MOST_REPEATED = 0.1


def no_repeats(n_repeated: int, n_poses: int) -> Finding:
    """Look at poses with exactly the readings of an earlier one at the same place."""
    values = {"n_repeated": n_repeated, "n": n_poses}
    if n_repeated <= _MOST_REPEATED * n_poses:
        return Established(values)
    return doubt(
        f"{n_repeated} of {counted(n_poses, 'pose')} have exactly the readings of "
        "another at the same place: noise never repeats itself, so that these are "
        "copies, or presses without a move. Each counts as a measurement, and all "
        "standard deviations are stated too small.",
        "Delete the copies; leave the place and come back between two touches.",
        values,
    )
