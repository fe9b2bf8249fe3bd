"""Score of a diagnosis with known truth.

The truth is passed as plain values, however effects were hidden. A name counts as right
modulo its aliases: names that the campaign's poses cannot distinguish.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from traverse.lab.diagnosis.model.result import Diagnosis
from traverse.lab.outcomes.diagnosis import Status, Term, Verdict

Identity = tuple[str, str | None, int | None, str | None, str | None]
Value = float | tuple[float, ...]

# Of the largest component's: a component of less is no freedom. Vectors across an axis
# have a small one along it where the true axis is not quite the designed one.
_LEAST_STD = 0.02


@dataclass(frozen=True, slots=True)
class TrueTerm:
    """A hidden effect.

    Attributes:
        identity: kind, joint, order, component of a runout, artefact; a kind that
            no name of the library fits is none of the arm file's.
        sizes: keys of the arm file that are estimated, with their true values.
        aliases: other names of the same effect.
        in_library: a name of the arm file fits.
    """

    identity: Identity
    sizes: Mapping[str, Value]
    aliases: frozenset[Identity] = frozenset()
    in_library: bool = True

    @property
    def joint(self) -> str | None:
        return self.identity[1]

    @property
    def names(self) -> frozenset[Identity]:
        return self.aliases | {self.identity}

    @property
    def joints(self) -> frozenset[str | None]:
        return frozenset(name[1] for name in self.names)


@dataclass(frozen=True, slots=True)
class Score:
    """Comparison of a diagnosis with the hidden effects.

    Attributes:
        exact: the strongest term bears a name of a true one.
        right_joint: the strongest term is at the joint of a true one.
        in_set: a true name is among the strongest term's name and alternatives.
        set_size: number of names of the strongest term, aliases counted as one.
        unknown_right_joint: an unknown term is at the joint of a true one.
        confident_wrong: a term is called named, and its name is wrong.
        n_matched: true terms whose names were found.
        all_exact: every true term found, and nothing else.
        n_spurious: terms beyond those that match.
        deviations: of estimated keys from the truth, in stated standard deviations,
            if the name is exactly right.
    """

    verdict: Verdict
    detected: bool
    n_terms: int
    exact: bool
    right_joint: bool
    in_set: bool
    set_size: int
    single: bool
    unknown: bool
    unknown_right_joint: bool
    confident_wrong: bool
    n_matched: int
    all_exact: bool
    n_spurious: int
    deviations: tuple[float, ...]


def scored(truths: tuple[TrueTerm, ...], diagnosis: Diagnosis) -> Score:
    """Compare found with hidden effects.

    Args:
        truths: hidden; none on clean data.
        diagnosis: result.
    """
    return scored_terms(truths, diagnosis.terms, diagnosis.verdict)


def scored_terms(
    truths: tuple[TrueTerm, ...], terms: tuple[Term, ...], verdict: Verdict
) -> Score:
    """Compare terms with the hidden effects; see `scored`."""
    first = max(terms, key=_strength, default=None)
    names = frozenset().union(*(truth.names for truth in truths))
    joints = frozenset().union(*(truth.joints for truth in truths))
    matched = _matches(truths, terms)
    n_matched = len(matched)
    unknown = [term for term in terms if term.status == "unknown"]
    wrong = [
        term
        for term in terms
        if term.status == "named" and term.candidate.identity not in names
    ]
    return Score(
        verdict=verdict,
        # Without anything hidden, more noise than stated is no claim of an effect.
        detected=verdict not in (("clean",) if truths else ("clean", "unexplained")),
        n_terms=len(terms),
        exact=first is not None and _is_one_of(first, names),
        right_joint=first is not None and first.candidate.joint in joints,
        in_set=first is not None and bool(_set_of(first) & names),
        set_size=0 if first is None else _set_size(first, truths),
        single=first is not None
        and first.status != "unknown"
        and _set_size(first, truths) == 1,
        unknown=bool(unknown),
        unknown_right_joint=any(term.candidate.joint in joints for term in unknown),
        confident_wrong=bool(wrong),
        n_matched=n_matched,
        all_exact=n_matched == len(truths) == len(terms),
        n_spurious=len(terms) - n_matched,
        deviations=tuple(
            deviation
            for truth, term in matched
            if term.candidate.identity == truth.identity
            for deviation in deviations(truth, term)
        ),
    )


def deviations(truth: TrueTerm, term: Term) -> tuple[float, ...]:
    """Compute (estimated - true) / std of every number of a term."""
    sizes: list[float] = []
    for key, size in truth.sizes.items():
        estimate = term.parameters.get(key)
        if estimate is None:
            continue
        errors = np.atleast_1d(estimate.value) - np.atleast_1d(size)
        if key == "phase_rad":
            errors = np.angle(np.exp(1j * errors))
        stds = np.atleast_1d(estimate.std)
        free = stds > _LEAST_STD * np.max(stds, initial=0.0)
        sizes += (errors[free] / stds[free]).tolist()
    return tuple(sizes)


def pooled_gap(gaps: list[tuple[float, float, float]]) -> float | None:
    """Pool the closed part of the gap over many diagnoses.

    Args:
        gaps: held-out mean squares before, after, and of the oracle: the model with
            the true effects.

    Returns:
        sum(before - after) / sum(before - oracle), None without a gap.
    """
    closed = sum(before - after for before, after, _ in gaps)
    possible = sum(before - oracle for before, _, oracle in gaps)
    return closed / possible if possible > 0.0 else None


def _strength(term: Term) -> float:
    return term.log_bayes_factor


def _has_name(status: Status) -> bool:
    return status != "unknown"


def _is_one_of(term: Term, names: frozenset[Identity]) -> bool:
    return _has_name(term.status) and term.candidate.identity in names


def _matches(
    truths: tuple[TrueTerm, ...], terms: tuple[Term, ...]
) -> list[tuple[TrueTerm, Term]]:
    """Pair true terms with found ones, each once; exact names before aliases."""
    pairs: list[tuple[TrueTerm, Term]] = []
    left = list(terms)
    missing = list(truths)
    for exactly in (True, False):
        for truth in tuple(missing):
            names = frozenset({truth.identity}) if exactly else truth.names
            match = next((term for term in left if _is_one_of(term, names)), None)
            if match is not None:
                pairs.append((truth, match))
                left.remove(match)
                missing.remove(truth)
    return pairs


def _set_of(term: Term) -> frozenset[Identity]:
    identities = (other.candidate.identity for other in term.alternatives)
    return frozenset(identities) | {term.candidate.identity}


def _set_size(term: Term, truths: tuple[TrueTerm, ...]) -> int:
    """Count the names that a term leaves, its aliases and the truth's as one."""
    name = term.candidate.identity
    rival_identities = {
        other.candidate.identity for other in term.alternatives if not other.alias
    } - {name}
    for truth in truths:
        if name in truth.names:
            rival_identities -= truth.names
        elif rival_identities & truth.names:
            rival_identities = (rival_identities - truth.names) | {truth.identity}
    return 1 + len(rival_identities)
