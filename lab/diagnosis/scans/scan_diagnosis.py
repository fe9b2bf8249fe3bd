"""Diagnosis of a dense scan: thinned for the tests, whole for the harmonics.

The thinned poses go the way of every campaign. What they leave over is then looked
through for harmonics in all samples; one that is found there enters the model, and
the thinned poses are diagnosed again with it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.diagnosis.diagnose import diagnose
from traverse.lab.diagnosis.holdout.comparison import compare_on_holdout
from traverse.lab.diagnosis.model.candidate import effect_of_candidate
from traverse.lab.diagnosis.model.fit import begin, estimates_of
from traverse.lab.diagnosis.model.observation_equations import (
    ObservationEquations,
    equations_of,
)
from traverse.lab.diagnosis.model.result import Diagnosis, DiagnosisOptions
from traverse.lab.diagnosis.report.files import WORDS
from traverse.lab.diagnosis.scans.decimation import Decimation, decimated
from traverse.lab.diagnosis.scans.harmonics import (
    HarmonicFinding,
    first_significant,
    stream_harmonics,
)
from traverse.lab.diagnosis.search.forward_search import Progress, no_progress
from traverse.lab.diagnosis.terms import verdict_of
from traverse.lab.outcomes.diagnosis import Alternative, Term
from traverse.lab.report.quantities import picked

# Of the probability of a false alarm: what the harmonics of all samples get.
_SHARE = 0.1
# So many times as many poses are worth another diagnosis.
_WORTH_WHILE = 1.3
# Rivals: no less likely than one in so many, as log.
_SET = math.log(100.0)
_LOG_10 = math.log(10.0)


@dataclass(frozen=True, slots=True, eq=False)
class StreamDiagnosis:
    """Result of a dense scan.

    Attributes:
        diagnosis: Of the thinned poses, harmonics of the whole stream among its terms.
        thinning: Which samples those poses are.
        harmonics: Of all samples, what the terms leave over, the largest first.
        n_from_stream: Terms that all samples showed first; they lead the others.
    """

    diagnosis: Diagnosis
    thinning: Decimation
    harmonics: tuple[HarmonicFinding, ...]
    n_from_stream: int


def diagnose_stream(
    campaign: Campaign,
    arm: Arm,
    options: DiagnosisOptions | None = None,
    progress: Progress | None = None,
) -> StreamDiagnosis:
    """Diagnose an arm from a dense scan, as `diagnose`.

    Raises:
        IdentificationError: Arm and campaign do not fit together.
    """
    options, report = options or DiagnosisOptions(), progress or no_progress
    report("thinning the stream", 0.02)
    beginning = begin(campaign, arm)
    given, arm = arm, beginning.arm
    campaign, thinning = decimated(campaign, arm)
    first = diagnose(campaign.part(thinning.poses), arm, options, progress)
    if first.terms:
        # What is missing lasts longer than noise does: without it more can be kept.
        finer, again = decimated(campaign, first.adapted)
        if len(again.poses) > _WORTH_WHILE * len(thinning.poses):
            campaign, thinning = finer, again
            first = diagnose(campaign.part(again.poses), arm, options, progress)
    poses, diagnosis = campaign.part(thinning.poses), first
    added: list[tuple[HarmonicFinding, ...]] = []
    level = _SHARE * options.level
    while True:
        report("harmonics of all samples", 0.9)
        rows = equations_of(diagnosis.all_terms)
        harmonics = stream_harmonics(rows, campaign)
        best = first_significant(harmonics, level)
        if best is None or len(diagnosis.terms) + len(added) >= options.most_terms:
            break
        effect = effect_of_candidate(
            best.candidate, np.array(best.amplitudes_rad), rows
        )
        known_effects = diagnosis.arm.effects[: len(arm.effects) + len(added)]
        rivals = (finding for finding in harmonics if finding is not best)
        likely = (finding for finding in rivals if best.log_p - finding.log_p > -_SET)
        added.append((best, *likely))
        with_it = arm.model_copy(update={"effects": (*known_effects, effect)})
        diagnosis = diagnose(poses, with_it, options, progress)
    if added:
        rows = equations_of(diagnosis.all_terms)
        together = _together(first, diagnosis, rows, added)
        # Held-out poses got worse: nothing of it is accepted.
        diagnosis = first if together.vetoed else together
        added = [] if together.vetoed else added
    diagnosis = replace(
        diagnosis,
        arm=given,
        design=beginning.design,
        wrong_signs=beginning.wrong_signs,
        zero_offsets_rad=beginning.zero_offsets_rad,
    )
    return StreamDiagnosis(diagnosis, thinning, harmonics, len(added))


def _together(
    first: Diagnosis,
    diagnosis: Diagnosis,
    rows: ObservationEquations,
    added: Sequence[tuple[HarmonicFinding, ...]],
) -> Diagnosis:
    """Tell of harmonics of the stream as terms, in front of those found with them."""
    n_given = len(first.arm.effects)
    everything, gap = (
        compare_on_holdout(
            first.before,
            model,
            diagnosis.held_out,
            blunders=diagnosis.blunders,
            noise=diagnosis.all_terms.network.noise,
        )
        for model in (diagnosis.all_terms, diagnosis.after)
    )
    terms = tuple(
        _term(names, rows, n_given + index, diagnosis, accepted=not everything.is_worse)
        for index, names in enumerate(added)
    )
    start = first.ledger[0]
    added_names = ", ".join(term.candidate.name for term in terms)
    return replace(
        diagnosis,
        verdict=verdict_of((*terms, *diagnosis.terms), exceeded=diagnosis.exceeded),
        terms=(*terms, *diagnosis.terms),
        arm=first.arm,
        before=first.before,
        ledger=(
            replace(start, held_out=gap.before),
            replace(diagnosis.ledger[0], effect=added_names),
            *diagnosis.ledger[1:],
        ),
        gap=gap,
        vetoed=everything.is_worse,
    )


def _term(
    names: tuple[HarmonicFinding, ...],
    rows: ObservationEquations,
    index: int,
    diagnosis: Diagnosis,
    *,
    accepted: bool,
) -> Term:
    """Make a term of a harmonic; its values are those of the thinned poses."""
    effect = diagnosis.adapted.effects[index]
    best, *further = names
    return Term(
        status="tentative" if further else "named",
        candidate=best.candidate,
        effect=effect,
        parameters=estimates_of(rows, index),
        log_bayes_factor=_evidence(best),
        log10_p=best.log_p / _LOG_10,
        alternatives=tuple(
            Alternative(other.candidate, _evidence(other), math.nan, alias=False)
            for other in further
        ),
        accepted=accepted,
        in_arm_file=accepted,
    )


def _evidence(finding: HarmonicFinding) -> float:
    """Log Bayes factor of two amplitudes, their scale chosen best."""
    half = 0.5 * finding.statistic
    return half - 1.0 - math.log(half) if half > 1.0 else 0.0


SCHEMA = "traverse/stream-diagnosis/1"
_N_TOLD = 10


def stream_lines(result: StreamDiagnosis) -> list[str]:
    lasting_s = [
        seconds for seconds in result.thinning.lasting_s if math.isfinite(seconds)
    ]
    largest = result.harmonics[0] if result.harmonics else None
    size_rad = math.hypot(*largest.amplitudes_rad) if largest else None
    return WORDS.lines("stream", result.thinning, max(lasting_s), largest, size_rad)


def stream_json(result: StreamDiagnosis) -> dict[str, Any]:
    thinning, artefacts = result.thinning, result.diagnosis.campaign.artefacts
    return {
        "schema": SCHEMA,
        "samples": thinning.n_samples,
        "rate_hz": round(thinning.rate_hz, 6),
        "poses": len(thinning.poses),
        "artefacts": {
            artefact.id: {
                "noise_lasts_s": round(lasting, 9),
                "poses_apart_s": round(apart, 9),
            }
            for artefact, lasting, apart in zip(
                artefacts, thinning.lasting_s, thinning.apart_s, strict=True
            )
            if math.isfinite(lasting)
        },
        "terms_from_all_samples": result.n_from_stream,
        "harmonics": [
            {
                **picked(finding.candidate, "kind", "joint", "order"),
                "cos_rad": finding.amplitudes_rad[0],
                "sin_rad": finding.amplitudes_rad[1],
                "std_rad": finding.std_rad,
                "log10_p": finding.log_p / _LOG_10,
            }
            for finding in result.harmonics[:_N_TOLD]
        ],
    }
