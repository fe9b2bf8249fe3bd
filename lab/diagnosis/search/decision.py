"""The decision: what is missing, from the choosing poses alone, and its names."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.effect_table import EFFECT_KINDS, Family
from traverse.kinematics.effects.contacts.touching import ArtefactLength
from traverse.lab.adjustment import IdentificationError
from traverse.lab.campaign.campaign import Campaign
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
    Fit,
    estimates_of,
    fitted,
    rows_without,
)
from traverse.lab.diagnosis.model.observation_equations import (
    ObservationEquations,
    SerialCorrelation,
    equations_of,
    is_serially_correlated,
    likeliest_serial_noise,
    serial_correlation,
)
from traverse.lab.diagnosis.model.result import DiagnosisOptions
from traverse.lab.diagnosis.search.forward_search import (
    DECIDED,
    NAMED_BANKS,
    Progress,
    ScoredCandidate,
    SearchState,
    effect_of,
    fit_any_curve_together,
    forward_search,
    joints_with_curve,
    no_progress,
    noise_draws,
    ranked,
    refitted,
    scores_at,
)
from traverse.lab.outcomes.candidate import BankName, Candidate
from traverse.lab.outcomes.diagnosis import Alternative, Status

# Whoever is within this of the best belongs to the printed set.
_SET = float(np.log(100.0))
# A name does not suffice if a curve of its own kind is left over beside it with a
# smaller p-value: few are tested, not all of the bank.
_LEFT_OVER_LOG_P = float(np.log(0.02))
_OVERTONES = (2, 3, 4)
_OVERTONE_LOG_P = float(np.log(0.02))
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
        own: What speaks for it, all other terms in the model.
        harmonic: Periods a turn of a periodic discrepancy without a name, or None.
        alternatives: What else it may be, the best first.
        best: The best name of all, which may be another.
        is_oversized: Whether no machine has as much of it.
        is_negative: Whether it is a compliance that yields against the weight or the
            force: then something follows these, and nothing yields.
    """

    added: AddedTerm
    own: ScoredCandidate
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
    others = [term for term in search.terms if term is not added]
    joints_with_own_curve = joints_with_curve(others)
    names = ranked(stage, NAMED_BANKS, joints_with_own_curve)
    curves = ranked(stage, (BankName.GENERIC,), joints_with_own_curve)
    # A term may be a function of a reading that got a curve after it.
    chosen = own_choice(added, stage, ranked(stage, tuple(BankName), ()))
    if added.candidate.is_curve:
        rivals = _rivals(chosen, names + curves[:1], chosen.score)
        return NamedTerm(added, chosen, "unknown", None, rivals, chosen)
    best = names[0] if names else chosen
    harmonic = _with_overtones(search, chosen.candidate)
    status: Status = "named"
    oversized = _is_oversized(search, added)
    negative = _is_negative(search, added)
    if harmonic is not None or oversized or negative:
        status = "unknown"
    elif _is_doubtful(search, chosen, names, curves):
        status = "tentative"
    shown = names + [curve for curve in curves[:1] if curve.score > chosen.score - _SET]
    shown += _lengths_of_all(stage)
    rivals = _rivals(chosen, shown, max(best.score, chosen.score))
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
    artefacts = [at.artefact for at in stations if at.artefact.id in certified]
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
    bank = Bank(candidates, _SHARED_PPM * np.hstack(columns))
    findings = judge(rows, project(rows, bank))
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
    wanted = added.candidate
    same = [
        choice
        for choice in choices
        if choice.candidate.identity == wanted.identity
        and choice.candidate.covariate == wanted.covariate
        and (not wanted.is_curve or choice.candidate.component == "angle")
    ]
    if same:
        return same[0]
    residuals = stage.rows.residuals
    columns = np.zeros((len(residuals), wanted.size))
    (nothing,) = project(stage.rows, Bank((wanted,), columns))
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


def _rivals(
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
        rho = correlation(chosen.found, chosen.residuals, choice.found)
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
        and correlation(chosen.found, chosen.residuals, rival.found) < ALIAS
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


def _with_overtones(search: SearchState, candidate: Candidate) -> int | None:
    """Return the order of a harmonic that has overtones too: it is no pure one."""
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
    whole = replace(
        members[0],
        parameters=tuple(f"{m.order}.{p}" for m in members for p in m.parameters),
        scales=tuple(scale for m in members for scale in m.scales),
    )
    bank = Bank((whole,), np.concatenate(parts, axis=1))
    scores = judge(stage.rows, project(stage.rows, bank))
    return order if float(scores.log_p[0]) < _OVERTONE_LOG_P else None


# Another name must be better by this much to take a term's place.
_BETTER = 1.0
_SERIAL_LEVEL = 0.01
# Less says nothing about noise, and so nothing about effects.
_LEAST_REDUNDANCY = 10
_LEAST_TRAVEL_RAD = np.radians(2.0)
_MOST_REVISIONS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """Outcome of a decision.

    Attributes:
        start: Fit without terms to the eligible poses, as an identification.
        stuck_rivals: What else the stuck curve of the search may be.
    """

    search: SearchState
    names: tuple[NamedTerm, ...]
    start: Fit
    stuck_rivals: tuple[Alternative, ...] = ()


def decide(
    campaign: Campaign,
    arm: Arm,
    eligible: Booleans,
    options: DiagnosisOptions,
    progress: Progress = no_progress,
) -> Decision:
    """Search with white noise, and again with serial noise if that is what is left.

    Only eligible poses, (n_poses,), are used for choosing; those that only their
    orientation excludes take part again without it.

    Raises:
        IdentificationError: The poses are too few, or too much alike.
    """
    progress("fitting the geometry", 0.05)
    start = fitted(campaign, arm, eligible)
    _check(campaign, start)
    progress("judging every candidate", 0.15)
    search, names = _revised(
        forward_search(start, eligible, options, None, progress), eligible
    )
    serial = _serial_noise(campaign, search, names, options)
    if serial is not None:
        search, names = _revised(
            forward_search(start, eligible, options, serial, progress), eligible
        )
    turned = eligible & search.fit.contradicted_by_orientation()
    if np.any(turned):
        remaining = campaign.without_orientations(turned)
        return decide(remaining, arm, eligible, options, progress)
    return Decision(search, names, start, _stuck_rivals(search))


def _serial_noise(
    campaign: Campaign,
    search: SearchState,
    names: Sequence[NamedTerm],
    options: DiagnosisOptions,
) -> SerialCorrelation | None:
    """Find serial noise beside what a search with white noise found; None: it is white.

    Strategy: where the search found a drift, or a curve over time, that took the place
    of slow noise, nothing serial is left beside it. So residuals without it are tested
    as well, and there the likelier one wins: slow noise has two parameters for all of
    its waves, a drift goes one way, a curve has as many as it has knots.
    """

    def is_serial(rows: ObservationEquations) -> bool:
        draws = noise_draws(rows, options.n_draws, options.seed)
        return is_serially_correlated(rows, draws, _SERIAL_LEVEL)

    if is_serial(search.unexplained):
        return serial_correlation(_rows_of_noise(campaign, search))
    slow = [
        naming.own.evidence for naming in names if _follows_time(naming.added.candidate)
    ]
    if search.stuck is not None and _follows_time(search.stuck.candidate):
        slow.append(search.stuck.evidence)
    if not slow:
        return None
    rows = _rows_of_noise(campaign, search)
    if not is_serial(rows):
        return None
    serial, evidence = likeliest_serial_noise(rows)
    return serial if evidence > sum(slow) else None


def _stuck_rivals(search: SearchState) -> tuple[Alternative, ...]:
    """List what else a curve may be that has no form in an arm file."""
    if search.stuck is None:
        return ()
    choices = ranked(search.stage, tuple(BankName), search.joints_with_own_curve)
    return _rivals(search.stuck, choices, search.stuck.score)


# Standard deviations of a mean square of white noise: more is more than was stated.
_BEYOND_STATED = 4.0


def _rows_of_noise(campaign: Campaign, search: SearchState) -> ObservationEquations:
    """Choose the rows whose residuals are noise, with or without what was found.

    Strategy: a drift and noise that is correlated from pose to pose look alike, and a
    search that takes noise for white finds drifts in it. So the noise is by default
    what is left before any term took its part. But stated noise says how much there can
    be of it: where residuals exceed that, the excess is something else, and to count it
    as noise would hide it. If terms that do not follow the time explain the excess, a
    backlash say, then noise is what is left beside these; else the excess is a drift, a
    temperature or a force, and noise is what is left beside all terms.
    """
    first = search.first.rows
    if not campaign.states_noise:
        return first
    if not _exceeds_stated(first):
        return first
    slow = {term.index for term in search.terms if _follows_time(term.candidate)}
    effects = search.fit.arm.effects
    kept = tuple(effect for at, effect in enumerate(effects) if at not in slow)
    fit = refitted(search.fit, kept, search.fit.included, snooping=False)
    beside = equations_of(fit.adjustment)
    return search.unexplained if _exceeds_stated(beside) else beside


def _exceeds_stated(rows: ObservationEquations) -> bool:
    redundancy = max(rows.redundancy, 1)
    limit = 1.0 + _BEYOND_STATED * np.sqrt(2.0 / redundancy)
    return bool(rows.sum_of_squares / redundancy >= limit)


def _follows_time(candidate: Candidate) -> bool:
    family = EFFECT_KINDS[candidate.kind].family
    return family is Family.SLOW or candidate.covariate == "time_s"


def _check(campaign: Campaign, start: Fit) -> None:
    """Refuse what no test could judge."""
    n_poses = int(np.count_nonzero(start.included))
    travel_rad = np.ptp(campaign.poses.angles_rad, axis=0)
    if np.max(travel_rad) < _LEAST_TRAVEL_RAD:
        raise IdentificationError(
            f"the {len(campaign.poses)} poses are nearly the same: no joint turned by "
            f"more than {np.degrees(np.max(travel_rad)):.2g} degrees; nothing can be "
            "found in them; measure in varied postures"
        )
    redundancy = start.adjustment.redundancy
    if redundancy < _LEAST_REDUNDANCY:
        raise IdentificationError(
            f"{n_poses} poses leave {redundancy} equations beyond the unknowns "
            "(redundancy), and effects cannot be told from noise with fewer than "
            f"{_LEAST_REDUNDANCY}; measure more poses"
        )


def _revised(
    search: SearchState, eligible: Booleans
) -> tuple[SearchState, tuple[NamedTerm, ...]]:
    """Revise: names that became better replace others, terms without need leave."""
    names = name_terms(search)
    for _ in range(_MOST_REVISIONS):
        revision = _revision(search, names)
        if revision is None:
            break
        naming, better = revision
        search = _changed(search, naming.added, better, eligible)
        names = name_terms(search)
    return search, names


def _revision(
    search: SearchState, names: tuple[NamedTerm, ...]
) -> tuple[NamedTerm, ScoredCandidate | None] | None:
    """Find the term that should go or change its name, with the better name."""
    for naming in names:
        if naming.own.log_p > search.thresholds[naming.added.candidate.bank]:
            return naming, None
    for naming in names:
        # A step keeps its name when its moment moves.
        if naming.own.candidate.at_s != naming.added.candidate.at_s:
            return naming, naming.own
        is_other = naming.best.candidate.identity != naming.added.candidate.identity
        if is_other and naming.best.score > naming.own.score + _BETTER:
            return naming, naming.best
    return None


def _changed(
    search: SearchState,
    added: AddedTerm,
    better: ScoredCandidate | None,
    eligible: Booleans,
) -> SearchState:
    """Take a term out of a search, or put another into its place."""
    effects = list(search.fit.arm.effects)
    terms = list(search.terms)
    at = terms.index(added)
    if better is None:
        del effects[added.index], terms[at]
        terms = [
            replace(term, index=term.index - (term.index > added.index))
            for term in terms
        ]
    else:
        effects[added.index] = effect_of(better, search.stage.rows)
        terms[at] = AddedTerm(better.candidate, added.index)
    fit = refitted(search.fit, tuple(effects), eligible)
    return replace(
        search, fit=fit, terms=tuple(terms), stage=scores_at(fit, search.serial)
    )
