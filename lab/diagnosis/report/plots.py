"""All pictures of a diagnosis, each painted once, by the name of its file."""

from dataclasses import dataclass

from traverse.lab.diagnosis.model.result import Diagnosis
from traverse.lab.diagnosis.report.discrepancies import Discrepancies, discrepancies
from traverse.lab.diagnosis.report.maps import artefact_map, condition_map, joint_map
from traverse.lab.diagnosis.report.pictures import ledger_picture, term_picture
from traverse.lab.diagnosis.report.term_curve import term_curve


@dataclass(frozen=True, slots=True, eq=False)
class Plots:
    """Pictures of the page, as PNG.

    Attributes:
        before: Measurement against the model without terms.
        after: Against the model of the arm that is written, in units of the same
            noise.
        ledger: The gap after every term; None: no poses were kept aside.
        terms: Each term over what matters for it; None where there is no such picture.
        artefacts: Misclosures by artefact.
        joints: Discrepancy over the joints' angles.
        conditions: Over time, temperature, speed, direction, force.
    """

    before: Discrepancies
    after: Discrepancies
    ledger: bytes | None
    terms: tuple[bytes | None, ...]
    artefacts: bytes
    joints: bytes
    conditions: bytes

    @property
    def files(self) -> dict[str, bytes]:
        """By name of the file."""
        found = {
            "artefacts.png": self.artefacts,
            "joints.png": self.joints,
            "conditions.png": self.conditions,
        }
        if self.ledger is not None:
            found["ledger.png"] = self.ledger
        for number, png in enumerate(self.terms, start=1):
            if png is not None:
                found[f"term-{number}.png"] = png
        return found


def plots_of(diagnosis: Diagnosis) -> Plots:
    """Compare simulation and measurement, and paint all pictures."""
    noise = diagnosis.all_terms.network.noise
    before = discrepancies(diagnosis.before, noise)
    after = discrepancies(diagnosis.after, noise)
    everything = after
    if not diagnosis.writes_all_terms:
        everything = discrepancies(diagnosis.all_terms, noise)
    shown = ~diagnosis.excluded & ~diagnosis.blunders
    curves = [term_curve(diagnosis, t, before, everything) for t in diagnosis.terms]
    return Plots(
        before,
        after,
        ledger_picture(diagnosis),
        tuple(None if c is None else term_picture(c, shown) for c in curves),
        artefact_map(before, after, shown),
        joint_map(before, after, shown),
        condition_map(before, after, shown),
    )
