"""All pictures of a diagnosis, each painted once, by the name of its file."""

from dataclasses import dataclass

import numpy as np

from lab.diagnosis.compare import Discrepancies, discrepancies
from lab.diagnosis.diagnosis import Diagnosis
from lab.diagnosis.report.maps import artefact_map, condition_map, joint_map
from lab.diagnosis.report.pictures import ledger_picture, term_picture
from lab.diagnosis.report.term_curve import term_curve


@dataclass(frozen=True, slots=True, eq=False)
class Plots:
    """What the page shows, as PNG.

    Attributes:
        before: Measurement against the model without terms.
        after: Against the model with all accepted terms, in units of the same noise.
        ledger: The gap after every term.
        terms: Each term over what matters for it; None where there is no such picture.
        artefacts: Misclosures by artefact.
        joints: Discrepancy over the joints' angles.
        conditions: Over time, temperature, speed, direction, force.
    """

    before: Discrepancies
    after: Discrepancies
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


def plots_of(diagnosis: Diagnosis) -> Plots:
    """Compare simulation and measurement, and paint all pictures."""
    noise = diagnosis.after.network.noise
    before = discrepancies(diagnosis.before, noise)
    after = discrepancies(diagnosis.after, noise)
    shown = ~diagnosis.excluded & np.any(np.isfinite(after.misclosures_mm), axis=1)
    curves = [term_curve(diagnosis, t, before, after) for t in diagnosis.terms]
    return Plots(
        before,
        after,
        ledger_picture(diagnosis),
        tuple(None if c is None else term_picture(c, shown) for c in curves),
        artefact_map(before, after, shown),
        joint_map(before, after, shown),
        condition_map(before, after, shown),
    )
