"""What is asked of every result before an arm file is made of it."""

from collections.abc import Mapping, Sequence

from traverse.lab.outcomes.base import Established, Finding, Outcome, Shortfall, State

# A bad reason of these codes: an arm file of the result might be measured with.
_UNFIT = frozenset({"converged", "fit", "size", "redundancy", "scale"})
# Offsets of zeros, found by a search, that are reported.
_LEAST_OFFSET_RAD = 1e-4

NO_ARM = "an arm file of this result might be measured with"


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
