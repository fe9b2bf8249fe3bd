"""All pictures of a diagnosis, each painted once, by the name of its file."""

from dataclasses import dataclass

from traverse.lab.diagnosis.model.result import Diagnosis
from traverse.lab.diagnosis.report.discrepancies import Discrepancies, discrepancies
from traverse.lab.diagnosis.report.maps import artefact_map, condition_map, joint_map
from traverse.lab.diagnosis.report.pictures import ledger_picture, term_picture
from traverse.lab.diagnosis.report.term_curve import term_curve


@dataclass(frozen=True, slots=True, eq=False)
class Plots:
    """Comparisons of measurement and models, and the pictures of the page.

    Attributes:
        before: Against the model without terms.
        after: Against the model of the arm that is written, in units of the same
            noise.
        files: PNG by name of the file: artefacts, joints, conditions, ledger where
            poses were kept aside, and each term over what matters for it.
    """

    before: Discrepancies
    after: Discrepancies
    files: dict[str, bytes]


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
    found: dict[str, bytes | None] = {
        "artefacts.png": artefact_map(before, after, shown),
        "joints.png": joint_map(before, after, shown),
        "conditions.png": condition_map(before, after, shown),
        "ledger.png": ledger_picture(diagnosis),
    }
    for number, curve in enumerate(curves, start=1):
        if curve is not None:
            found[f"term-{number}.png"] = term_picture(curve, shown)
    files = {name: png for name, png in found.items() if png is not None}
    return Plots(before, after, files)
