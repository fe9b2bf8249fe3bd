"""All pictures of a diagnosis, each painted once, by the name of its file."""

from dataclasses import dataclass

from traverse.arrays import Booleans
from traverse.lab.diagnosis.holdout.comparison import uncontradicted
from traverse.lab.diagnosis.model.result import Diagnosis
from traverse.lab.diagnosis.report.discrepancies import Discrepancies, discrepancies
from traverse.lab.diagnosis.report.maps import artefact_map, condition_map, joint_map
from traverse.lab.diagnosis.report.pictures import ledger_picture, term_picture
from traverse.lab.diagnosis.report.term_curve import term_curve


@dataclass(frozen=True, slots=True, eq=False)
class Plots:
    """What the page shows, as PNG.

    Attributes:
        before: Measurement against the model without terms.
        after: Against the model with all accepted terms, in units of the same noise.
        contradicting: Held-out poses that no model explains, (n_poses,): not shown.
        ledger: The gap after every term.
        terms: Each term over what matters for it; None where there is no such picture.
        artefacts: Misclosures by artefact.
        joints: Discrepancy over the joints' angles.
        conditions: Over time, temperature, speed, direction, force.
    """

    before: Discrepancies
    after: Discrepancies
    contradicting: Booleans
    ledger: bytes
    terms: tuple[bytes | None, ...]
    artefacts: bytes
    joints: bytes
    conditions: bytes

    @property
    def files(self) -> dict[str, bytes]:
        """By name of the file."""
        found = {
            "ledger.png": self.ledger,
            "artefacts.png": self.artefacts,
            "joints.png": self.joints,
            "conditions.png": self.conditions,
        }
        for number, png in enumerate(self.terms, start=1):
            if png is not None:
                found[f"term-{number}.png"] = png
        return found


def contradicting_held_out(diagnosis: Diagnosis) -> Booleans:
    """Find held-out poses that contradict the final model: blunders, (n_poses,)."""
    radius_mm = diagnosis.arm.probe.radius_mm
    held_out = diagnosis.held_out
    return held_out & ~uncontradicted(diagnosis.after, held_out, radius_mm)


def plots_of(diagnosis: Diagnosis) -> Plots:
    """Compare simulation and measurement, and paint all pictures."""
    noise = diagnosis.after.network.noise
    before = discrepancies(diagnosis.before, noise)
    after = discrepancies(diagnosis.after, noise)
    contradicting = contradicting_held_out(diagnosis)
    shown = ~diagnosis.excluded & ~contradicting
    curves = [term_curve(diagnosis, t, before, after) for t in diagnosis.terms]
    return Plots(
        before,
        after,
        contradicting,
        ledger_picture(diagnosis),
        tuple(None if c is None else term_picture(c, shown) for c in curves),
        artefact_map(before, after, shown),
        joint_map(before, after, shown),
        condition_map(before, after, shown),
    )
