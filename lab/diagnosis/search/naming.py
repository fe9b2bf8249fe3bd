"""Names of terms: how sure each is, and what else it may be."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects.contacts.touching import (
    ArtefactLength,
    ProbeRadius,
    StylusBending,
)
from traverse.lab.diagnosis.candidates.candidate_scores import (
    CandidateScores,
    score_banks,
)
from traverse.lab.diagnosis.candidates.scoring import (
    ALIAS,
    ProjectedCandidate,
    judge,
    project,
)
from traverse.lab.diagnosis.model.candidate import Bank
from traverse.lab.diagnosis.model.fit import (
    AddedTerm,
    estimates_of,
    rows_without,
)
from traverse.lab.diagnosis.search.forward_search import (
    DECIDED,
    NAMED_BANKS,
    ScoredCandidate,
    SearchState,
    fit_any_curve_together,
    joints_with_curve,
    ranked,
)
from traverse.lab.outcomes.candidate import BankName, Candidate
from traverse.lab.outcomes.diagnosis import Alternative, Status

# Candidates within these log odds of the best are reported.
_SET = float(np.log(100.0))
# A name does not suffice if a curve of its own kind is left over beside it with a
# smaller p-value: few are tested, not all of the bank.
_LEFT_OVER_LOG_P = float(np.log(0.02))
_OVERTONES = (2, 3, 4)
_OVERTONE_LOG_P = float(np.log(0.02))
_OVERTONE_SHARE = 0.01  # of what the wave explains: a tenth of its amplitude
# What no arm has, not even one that somebody printed and glued: by the effect's key.
_NO_MACHINE = {
    **dict.fromkeys(("cos_mm", "sin_mm", "amplitude_mm", "radius_error_mm"), 2.0),
    **dict.fromkeys(("cos_rad", "sin_rad", "half_width_rad"), 0.1),
}
# By which all standards of a campaign may well be off, by their temperature or unit.
_SHARED_PPM = 100.0
_COMPLIANCES = ("compliance_rad_nm", "compliance_mm_n")


@dataclass(frozen=True, slots=True, eq=False)
class NamedTerm:
    """A term with its name.

    Attributes:
        choice: What speaks for it, all other terms in the model.
        harmonic: Periods a turn of a periodic discrepancy without a name, or None.
        alternatives: What else it may be, the best first.
        best: The best name of all, which may be another.
        is_oversized: Whether no machine has as much of it.
        is_negative: Whether it is a compliance that yields against the weight or the
            force: then something follows these, and nothing yields.
    """

    added: AddedTerm
    choice: ScoredCandidate
    status: Status
    harmonic: int | None
    alternatives: tuple[Alternative, ...]
    best: ScoredCandidate
    is_oversized: bool = False
    is_negative: bool = False


def name_terms(search: SearchState) -> tuple[NamedTerm, ...]:
    """Judge every term of a search with all others in the model."""
    return tuple(_naming(search, added) for added in search.terms)


def _naming(search: SearchState, added: AddedTerm) -> NamedTerm:
    without = rows_without(search.stage.rows, added.index)
    stage = score_banks(without, search.stage.banks)
    further = [term for term in search.terms if term is not added]
    joints_with_own_curve = joints_with_curve(further)
    names = ranked(stage, NAMED_BANKS, joints_with_own_curve)
    curves = ranked(stage, (BankName.GENERIC,), joints_with_own_curve)
    # A term may be a function of a reading that got a curve after it.
    chosen = own_choice(added, stage, ranked(stage, tuple(BankName), ()))
    if added.candidate.is_curve:
        rivals = rivals_of(chosen, names + curves[:1], chosen.score)
        return NamedTerm(added, chosen, "unknown", None, rivals, chosen)
    best = names[0] if names else chosen
    harmonic = _with_overtones(search, chosen)
    status: Status = "named"
    oversized = _is_oversized(search, added)
    negative = _is_negative(search, added)
    if harmonic is not None or oversized or negative:
        status = "unknown"
    elif _is_doubtful(search, chosen, names, curves):
        status = "tentative"
    shown = names + [curve for curve in curves[:1] if curve.score > chosen.score - _SET]
    shown += _lengths_of_all(stage)
    yielding = _yielding_contacts(stage, chosen)
    shown += yielding
    rivals = rivals_of(chosen, shown, max(best.score, chosen.score))
    may_be_another = any(rival.candidate.is_length for rival in rivals)
    if status == "named" and chosen.candidate.is_length and may_be_another:
        # Whoever corrects a right certificate gives the arm another scale.
        status = "tentative"
    if status == "named" and any(
        rival.score > chosen.score + DECIDED for rival in yielding
    ):
        status = "tentative"
    return NamedTerm(added, chosen, status, harmonic, rivals, best, oversized, negative)


def _lengths_of_all(stage: CandidateScores) -> list[ScoredCandidate]:
    """Judge that all standards, or all distances, are longer than stated by one factor.

    Strategy: the arm takes up such a factor as its scale, and what is left, at radii,
    looks like a wrong radius of the probe. No arm file has it, so that it is a rival
    only.
    """
    rows = stage.rows
    certified = {of for _, of, _ in rows.certificates}
    stations = rows.adjustment.network.stations
    artefacts = [
        station.artefact for station in stations if station.artefact.id in certified
    ]
    distances = [entry for entry in artefacts if entry.certifies_distance]
    shared = [
        tuple(entry.id for entry in some)
        for some in ([artefacts, distances] if distances != artefacts else [artefacts])
        if len(some) > 1
    ]
    if not shared:
        return []
    candidates = tuple(
        Candidate(
            kind=ArtefactLength.kind,
            joint=None,
            bank=BankName.LIBRARY,
            artefact=", ".join(names),
            parameters=("error_ppm",),
            scales=(_SHARED_PPM,),
        )
        for names in shared
    )
    columns = [
        np.sum([rows.by_artefact_length(name) for name in names], axis=0)
        for names in shared
    ]
    return _judged(stage, Bank(candidates, _SHARED_PPM * np.hstack(columns)))


def _yielding_contacts(
    stage: CandidateScores, chosen: ScoredCandidate
) -> list[ScoredCandidate]:
    """Judge that contacts give way along their normal, in proportion to the force.

    Strategy: a wrong radius shifts all contacts alike, a stylus that bends those across
    it; what is touched, or a trigger, may give way as well, and looks like either. No
    arm file has it, so that it is a rival only. With an unknown force, which then is
    the same everywhere, it cannot be told from a radius.
    """
    if chosen.candidate.kind not in (ProbeRadius.kind, StylusBending.kind):
        return []
    rows, library = stage.rows, stage.banks[BankName.LIBRARY]
    poses = rows.adjustment.network.campaign.poses
    by_force = np.ones(len(poses))
    if poses.force_n is not None and np.any(np.isfinite(poses.force_n)):
        by_force = poses.force_n / np.nanmean(poses.force_n)
        by_force[np.isnan(by_force)] = 1.0
    return [
        rival
        for candidate, part in zip(library.candidates, library.slices, strict=True)
        if candidate.kind == ProbeRadius.kind
        for rival in _judged(
            stage,
            Bank(
                (replace(candidate, covariate="force_n"),),
                library.columns[:, part] * by_force[rows.poses, np.newaxis],
            ),
        )
    ]


def _judged(stage: CandidateScores, bank: Bank) -> list[ScoredCandidate]:
    """Judge rivals that are in no bank."""
    findings = judge(stage.rows, project(stage.rows, bank))
    stage = replace(stage, findings={BankName.LIBRARY: findings})
    return ranked(stage, (BankName.LIBRARY,), ())


def of_single_joints(
    naming: NamedTerm, names: Sequence[NamedTerm]
) -> tuple[NamedTerm, ...]:
    """List the terms of single joints whose kind a term of all joints has, too.

    What such a term shares among the joints is what the others leave over of one.
    """
    shared = naming.added.candidate
    if shared.joint is not None or shared.is_curve:
        return ()
    candidates = ((other, other.added.candidate) for other in names)
    return tuple(
        other
        for other, candidate in candidates
        if candidate.kind == shared.kind and candidate.joint is not None
    )


def _is_oversized(search: SearchState, added: AddedTerm) -> bool:
    estimates = estimates_of(search.stage.rows, added.index)
    return any(
        bool(np.max(np.abs(estimates[key].value)) > most)
        for key, most in _NO_MACHINE.items()
        if key in estimates
    )


def _is_negative(search: SearchState, added: AddedTerm) -> bool:
    estimates = estimates_of(search.stage.rows, added.index)
    return any(
        bool(np.min(estimates[key].value) < 0.0)
        for key in _COMPLIANCES
        if key in estimates
    )


def own_choice(
    added: AddedTerm, stage: CandidateScores, choices: Sequence[ScoredCandidate]
) -> ScoredCandidate:
    """Find a term among the candidates.

    One that is not there any more, because the unknowns and the other terms do all
    that it could do, explains nothing.
    """
    candidate = added.candidate
    same = [
        choice
        for choice in choices
        if choice.candidate.identity == candidate.identity
        and choice.candidate.covariate == candidate.covariate
        and (not candidate.is_curve or choice.candidate.component == "angle")
    ]
    if same:
        return same[0]
    residuals = stage.rows.residuals
    columns = np.zeros((len(residuals), candidate.size))
    (nothing,) = project(stage.rows, Bank((candidate,), columns))
    return ScoredCandidate(nothing, 0.0, 0.0, 0.0, residuals)


def correlation(
    finding: ProjectedCandidate, residuals: Floats, other: ProjectedCandidate
) -> float:
    """Return how much of a finding another block explains, 0 to 1."""
    explained = finding.directions @ (finding.directions.T @ residuals)
    size = float(np.linalg.norm(explained))
    if size == 0.0:
        return 0.0
    return float(np.linalg.norm(other.directions.T @ explained)) / size


def rivals_of(
    chosen: ScoredCandidate, choices: Sequence[ScoredCandidate], top: float
) -> tuple[Alternative, ...]:
    """List what is as good as the best, but for the name itself.

    Also what only a prior size excludes, and no measurement here.
    """
    alternatives = []
    for choice in choices:
        same = choice.candidate.identity == chosen.candidate.identity
        is_near = choice.score >= top - _SET
        if not (is_near or choice.log_p < chosen.log_p + DECIDED) or (
            same and choice.candidate.covariate == chosen.candidate.covariate
        ):
            continue
        rho = correlation(chosen.projected, chosen.residuals, choice.projected)
        # A curve that follows an effect closely is no other name for it.
        alias = rho >= ALIAS and not choice.candidate.is_curve
        if not (is_near or alias):
            continue
        alternatives.append(Alternative(choice.candidate, choice.evidence, rho, alias))
    return tuple(alternatives)


def _is_doubtful(
    search: SearchState,
    chosen: ScoredCandidate,
    names: Sequence[ScoredCandidate],
    curves: Sequence[ScoredCandidate],
) -> bool:
    """Return whether a name is too uncertain to be reported alone.

    Because the evidence is small for having been looked for among so many, because
    another name or a curve is nearly as good, because a second term of the joint helps
    it to imitate a curve, because a curve of its own kind is left over beside it, or
    because something is still unexplained.
    """
    if chosen.evidence < DECIDED + np.log(len(names)) or not search.is_finished:
        return True
    if leaves_a_curve(search.stage, chosen.candidate):
        return True
    for term in search.terms:
        other = term.candidate
        is_curve = other.covariate == f"{chosen.candidate.joint}_rad"
        if is_curve and EFFECT_KINDS[chosen.candidate.kind].turns_with_joint:
            return True
        if other.identity != chosen.candidate.identity and fit_any_curve_together(
            search.stage.rows, chosen.candidate, other
        ):
            return True
    near = [
        rival for rival in (*names, *curves[:1]) if rival.score > chosen.score - DECIDED
    ]
    return any(
        rival.candidate.identity != chosen.candidate.identity
        and correlation(chosen.projected, chosen.residuals, rival.projected) < ALIAS
        for rival in near
    )


def leaves_a_curve(stage: CandidateScores, name: Candidate) -> bool:
    """Return whether a curve over what a name depends on explains more than it does."""
    if name.joint is None:
        return False
    row = EFFECT_KINDS[name.kind]
    covariates = row.columns(name.joint)
    curves = stage.findings[BankName.GENERIC]
    return any(
        candidate.joint == name.joint
        and candidate.component == row.acts_on
        and candidate.covariate in covariates
        and float(log_p) < _LEFT_OVER_LOG_P
        for candidate, log_p in zip(curves.candidates, curves.log_p, strict=True)
    )


def _with_overtones(search: SearchState, chosen: ScoredCandidate) -> int | None:
    """Return the order of a harmonic that has overtones too: it is no pure one.

    Strategy: beside a strong wave, or among thousands of poses, overtones far below
    what matters are significant; so they also have to be a share of the wave.
    """
    candidate = chosen.candidate
    if not EFFECT_KINDS[candidate.kind].is_wave:
        return None
    if candidate.bank is BankName.TRANSMISSION:
        return None
    order = candidate.order or 1
    stage = search.stage
    overtones = [
        (wave, bank.columns[:, columns])
        for bank in (stage.banks[name] for name in NAMED_BANKS if name in stage.banks)
        for wave, columns in zip(bank.candidates, bank.slices, strict=True)
        if EFFECT_KINDS[wave.kind].is_wave
        and wave.joint == candidate.joint
        and wave.order in [order * n for n in _OVERTONES]
    ]
    if not overtones:
        return None
    members, parts = zip(*overtones, strict=True)
    together = replace(
        members[0],
        parameters=tuple(f"{m.order}.{p}" for m in members for p in m.parameters),
        scales=tuple(scale for m in members for scale in m.scales),
    )
    bank = Bank((together,), np.concatenate(parts, axis=1))
    scores = judge(stage.rows, project(stage.rows, bank))
    explained = float(np.sum((chosen.projected.directions.T @ chosen.residuals) ** 2))
    is_share = float(scores.statistics[0]) > _OVERTONE_SHARE * explained
    return order if is_share and float(scores.log_p[0]) < _OVERTONE_LOG_P else None
