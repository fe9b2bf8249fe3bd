"""What a diagnosis says, in sentences; for the page and for terminals."""

import numpy as np

from traverse.lab.diagnosis.model.outlier_clusters import Cluster
from traverse.lab.diagnosis.model.result import Alternative, Diagnosis, Term
from traverse.lab.diagnosis.report.adapted_arm import terms_without_epoch
from traverse.lab.diagnosis.report.names import (
    candidate_label,
    cluster_text,
    odds,
    often,
    quantity,
    term_size_text,
)
from traverse.lab.report.quantities import length_mm

_MOST_RIVALS = 4
_MOST_LINES = 12
_LEAST_SHARE = 0.02


def verdict_sentences(diagnosis: Diagnosis) -> list[str]:
    """Say what was found, the most important first."""
    sentences = [*missing_sentences(diagnosis), held_out_sentence(diagnosis)]
    if diagnosis.vetoed:
        sentences.append(
            "The poses kept aside are predicted worse with what was found than "
            "without: nothing was added to the arm. Measure again, or more."
        )
    sentences += [
        f"To separate: {term.separate_by}"
        for term in diagnosis.terms
        if term.separate_by
    ]
    sentences += [_no_epoch(term) for term in terms_without_epoch(diagnosis)]
    return sentences


def missing_sentences(diagnosis: Diagnosis) -> list[str]:
    """Say what is missing, term by term, each with its rivals."""
    if not diagnosis.terms:
        n_poses = int(np.count_nonzero(diagnosis.choosing & ~diagnosis.excluded))
        return [
            "Clean: no effect of the library, no curve and no harmonic stands out of "
            f"the noise of {n_poses} poses. What would have been seen stands below."
        ]
    found = []
    for term in diagnosis.terms:
        found.append(_missing(term))
        found += rival_sentences(term)
    return found


def _missing(term: Term) -> str:
    if term.cluster is not None:
        return cluster_sentence(term.cluster)
    name, size = candidate_label(term.candidate), term_size_text(term)
    told = f"{name} ({size})" if size else name
    if term.status == "named":
        said = f"Missing effect: {told}."
    elif term.status == "tentative":
        said = (
            f"Missing effect, tentatively: {told}; it is not the only name that fits."
        )
    else:
        wave = (
            f"; it repeats {often(term.harmonic)} a turn"
            if term.harmonic is not None
            else ""
        )
        said = f"Missing, and no known effect explains it: {told}{wave}."
    if not term.accepted:
        said += " It is not in the adapted arm."
    return said


def cluster_sentence(place: Cluster) -> str:
    """Say where poses that were left out lie together."""
    said = (
        f"Missing, and no known effect explains it: {place.n_excluded} poses that "
        f"contradict all others lie together {cluster_text(place)}, where there are "
        f"{place.n_poses} poses in all; blunders would lie anywhere. "
    )
    if place.artefact is not None:
        return said + "Look whether it moved, is dirty, or is not what its entry says."
    return said + "Measure more poses there, and look what happens to the arm there."


def rival_sentences(term: Term) -> list[str]:
    """Say what else a term may be."""
    open_ones = [one for one in term.alternatives if not one.alias]
    aliases = [one for one in term.alternatives if one.alias]
    found = []
    if open_ones:
        told = "; ".join(_rival(term, one) for one in open_ones[:_MOST_RIVALS])
        more = len(open_ones) - _MOST_RIVALS
        rest = f"; and {more} more" if more > 0 else ""
        found.append(f"Cannot be excluded: {told}{rest}.")
    if aliases:
        told = "; ".join(candidate_label(one.candidate) for one in aliases)
        found.append(
            f"The same thing to any poses of this kind (structural alias): {told}."
        )
    if not term.alternatives and term.status == "named":
        found.append("The data exclude every other effect of the library.")
    return found


def _rival(term: Term, rival: Alternative) -> str:
    evidence = odds(term.log_bayes_factor - rival.log_bayes_factor)
    return f"{candidate_label(rival.candidate)} (evidence {evidence})"


def held_out_sentence(diagnosis: Diagnosis) -> str:
    """Say what poses that were kept aside say about it."""
    first, last = diagnosis.ledger[0].held_out, diagnosis.ledger[-1].held_out
    if first.n == 0:
        return "No poses were kept aside: nothing proves that the gap shrank."
    if len(diagnosis.ledger) == 1:
        return (
            f"Held-out misfit {first.chi2:.2f} ({first.n} equations of poses that "
            f"were kept aside; 1 is noise alone), rms {length_mm(first.rms_mm)}."
        )
    said = (
        f"Held-out misfit {first.chi2:.3g} -> {last.chi2:.3g}, rms "
        f"{length_mm(first.rms_mm)} -> {length_mm(last.rms_mm)}"
    )
    if first.mean_distance_mm is not None and last.mean_distance_mm is not None:
        said += (
            f", mean distance {length_mm(first.mean_distance_mm)} -> "
            f"{length_mm(last.mean_distance_mm)}"
        )
    if diagnosis.closed is None:
        return (
            f"{said}. The misfit was so near to the noise that the part of the gap "
            "that is closed cannot be told."
        )
    # Poses may be predicted better than the noise leads to expect, by chance.
    percent = 100.0 * min(diagnosis.closed, 1.0)
    return f"{said} ({percent:.0f} % of what is achievable)."


def noise_sentences(diagnosis: Diagnosis) -> list[str]:
    """Say which noise was found."""
    noise, campaign = diagnosis.noise, diagnosis.campaign
    readings = _range(noise.encoder_rad, "rad")
    contacts = _range(noise.contact_mm, "mm")
    whence = (
        "estimated from the residuals"
        if campaign.encoder_rad is None or campaign.contact_mm is None
        else "from the campaign"
    )
    found = [
        f"Noise ({whence}): readings {readings}, contacts {contacts}; sigma0 "
        f"{diagnosis.before.sigma0:.3g} before, {diagnosis.after.sigma0:.3g} after. "
        "No test relies on the stated level of the noise."
    ]
    if noise.serial_share > _LEAST_SHARE:
        found.append(
            f"{100.0 * noise.serial_share:.0f} % of its variance is correlated from "
            f"pose to pose ({noise.serial_phi:.2f} from one to the next); all tests "
            "take that into account."
        )
    return found


def _range(values: tuple[float, ...], unit: str) -> str:
    least, largest = min(values), max(values)
    if least == largest:
        return quantity(least, None, unit)
    return f"{quantity(least, None, unit)} to {quantity(largest, None, unit)}"


def excluded_sentence(diagnosis: Diagnosis) -> str:
    """Say which poses contradict all others."""
    lines = sorted(diagnosis.campaign.poses.lines[diagnosis.excluded].tolist())
    n_poses = len(diagnosis.campaign.poses)
    if not lines:
        return f"No pose of {n_poses} contradicts the others."
    shown = ", ".join(str(line) for line in lines[:_MOST_LINES])
    more = ", ..." if len(lines) > _MOST_LINES else ""
    return (
        f"{len(lines)} of {n_poses} poses contradict the others and were left out "
        f"(line {shown}{more})."
    )


def _no_epoch(term: Term) -> str:
    return (
        f"{candidate_label(term.candidate).capitalize()} is not written to the arm "
        "file: it is bound to time, and the campaign does not say when it began. Give "
        "start_utc in campaign.toml."
    )


def summary_lines(diagnosis: Diagnosis) -> list[str]:
    """Say the most important things, a line each."""
    n_held_out = int(np.count_nonzero(diagnosis.held_out))
    return [
        f"{diagnosis.arm.name}: {len(diagnosis.campaign.poses)} poses, {n_held_out} of "
        f"them kept aside; verdict: {diagnosis.verdict}",
        *verdict_sentences(diagnosis),
        *noise_sentences(diagnosis),
        excluded_sentence(diagnosis),
    ]
