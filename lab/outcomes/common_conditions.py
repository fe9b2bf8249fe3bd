"""What several kinds of results ask alike, and what an arm file is made of."""

from collections.abc import Mapping, Sequence

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.outcomes.base import (
    Established,
    Finding,
    Outcome,
    Shortfall,
    State,
    doubt,
)
from traverse.plurals import counted

# Part of the poses that may be second presses in one posture.
_MOST_REPEATED = 0.1
# Part of the poses that may contradict the others.
_MOST_EXCLUDED = 0.1
# Plausible deviations from its design that a parameter of such an arm may have.
_MOST_DEVIATION = 8.0
# Of the arm's length: within less, places about the first axis are one.
_ONE_REACH = 0.05
# A bad reason of these codes: an arm file of the result might be measured with.
_UNFIT = frozenset({"converged", "fit", "size", "redundancy", "scale"})
# Offsets of zeros, found by a search, that are reported.
_LEAST_OFFSET_RAD = 1e-4

NO_ARM = "an arm file of this result might be measured with"


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


def is_many(n_excluded: int, n_poses: int) -> bool:
    """Return whether more poses contradict the others than blunders may be."""
    return n_excluded > _MOST_EXCLUDED * n_poses


def few_excluded(n_excluded: int, n_poses: int) -> Finding:
    """Look at the poses that took no part."""
    values = {"n_excluded": n_excluded, "n": n_poses}
    if not is_many(n_excluded, n_poses):
        return Established(values)
    text = f"{n_excluded} of {n_poses} poses contradict the others and took no part."
    return doubt(text, "Find out why before the arm is used.", values)


def like_design(changes: Mapping[str, float]) -> Finding:
    """Look at axes and links: zeros and tools are not the design's, nor are effects.

    Takes the changes of the free parameters, in plausible deviations, by name.
    """
    deviations = {
        name: abs(change)
        for name, change in changes.items()
        if ".axis." in name or ".link." in name
    }
    name = max(deviations, key=lambda name: deviations[name], default="")
    farthest = deviations.get(name, 0.0)
    values = {"parameter": name, "deviations": farthest}
    if farthest <= _MOST_DEVIATION:
        return Established(values)
    return doubt(
        f"The identified arm is not like its design: {name} is off by {farthest:.0f} "
        "times what is plausible. The arm file may be another arm's, or the arm was "
        "rebuilt.",
        "Compare the identified links with the arm.",
        values,
    )


def several_reaches(geometry: Geometry, angles_rad: Floats) -> Finding:
    """Compare places near the first axis with those far out, and high ones with low.

    What the model lacks, as bending by weight, changes with the reach. At one reach
    axes and links take its place, and no residual shows it.

    Args:
        geometry: The identified arm.
        angles_rad: Readings, (n_poses, n_joints).
    """
    places_mm = probe_centre(geometry, angles_rad) - geometry.origin_mm
    heights_mm = places_mm @ geometry.axes[0]
    radii_mm = np.linalg.norm(
        places_mm - heights_mm[:, np.newaxis] * geometry.axes[0], axis=1
    )
    (near_mm, far_mm), (low_mm, high_mm) = (
        np.percentile(lengths_mm, (5.0, 95.0)).tolist()
        for lengths_mm in (radii_mm, heights_mm)
    )
    values = {
        "least_radius_mm": near_mm,
        "largest_radius_mm": far_mm,
        "least_height_mm": low_mm,
        "largest_height_mm": high_mm,
    }
    arm_mm = float(np.sum(np.linalg.norm(geometry.links_mm, axis=1)))
    if max(far_mm - near_mm, high_mm - low_mm) > _ONE_REACH * arm_mm:
        return Established(values)
    return doubt(
        f"All poses are at one reach, {near_mm:.0f} to {far_mm:.0f} mm from the axis "
        f"of the first joint, {low_mm:.0f} to {high_mm:.0f} mm along it: what "
        "changes with the reach, as bending by weight, cannot show, and lengths "
        "elsewhere may be wrong by more than their uncertainty.",
        "Measure near the base and far out, high and low.",
        values,
    )


def like_family(
    family: str, contradicted: Sequence[tuple[str, float]], *, is_of_it: bool
) -> Finding:
    """Look whether the measurements contradict what an arm's family says."""
    if not contradicted:
        return Established()
    names = ", ".join(
        f"{sigmas:.3g} standard deviations in {name}" for name, sigmas in contradicted
    )
    left = (
        "this arm left its family there, and its own poses alone count."
        if is_of_it
        else "this arm is none of it, and nothing of it counts."
    )
    text = f"The measurements contradict the family {family} by {names}: {left}"
    return doubt(text, "Compare the arm with its family.")


def may_be_measured_with(outcome: Outcome) -> bool:
    """Return whether an arm file may be made of a result."""
    bad = {entry.code for entry in outcome.reasons if entry.state is State.BAD}
    return not bad & _UNFIT


def signs_and_zeros(
    wrong_signs: Sequence[str], offsets_rad: Mapping[str, float]
) -> Finding:
    """Report joints that turn the other way, and zeros that an arm file has not."""
    shortfalls = [
        Shortfall(
            f"The arm file as given did not fit: {joint} turns the other way. It was "
            "identified with the other sense, by an axis that points the other way.",
            f"Look which way the encoder of {joint} counts; the identified arm file "
            "has its axis reversed, and needs no other sign.",
            {"joint": joint},
        )
        for joint in wrong_signs
    ]
    far = {
        joint: rad for joint, rad in offsets_rad.items() if abs(rad) > _LEAST_OFFSET_RAD
    }
    if far:
        offsets = ", ".join(f"{joint} by {rad:+.4f} rad" for joint, rad in far.items())
        text = f"The arm file as given did not fit at all; other zeros do: {offsets}."
        values = {f"{joint}_offset_rad": rad for joint, rad in far.items()}
        shortfalls.append(Shortfall(text, "Check the arm file.", values))
    return shortfalls or Established()
