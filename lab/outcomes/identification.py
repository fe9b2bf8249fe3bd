"""What must be established before an identified arm is good, and before it is written.

Strategy: an arm file is measured with, so that one is written only where the campaign
could have shown that it is wrong (redundancy), where it explains the measurements as an
arm of this design can, and where the scale of the arm is known. Everything else that is
not established leaves a file, and a result in doubt or bad that says so.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from traverse.lab.outcomes.base import (
    Condition,
    Established,
    Outcome,
    Shortfall,
    State,
    judge,
)
from traverse.lab.outcomes.identified import ContradictedCertificate
from traverse.lab.report.quantities import length_mm, probability
from traverse.lab.statistics.distributions import GlobalTest
from traverse.plurals import counted

# Misclosures, as a part of the arm's length, that no arm like the design leaves.
MOST_MISCLOSURE = 0.005
# Factors between the design's length and the identified one that no arm is off by.
LEAST_SIZE, MOST_SIZE = 0.8, 1.25
# Plausible deviations from its design that a parameter of such an arm may have.
MOST_DEVIATION = 8.0
# sigma0 beyond which stated noise is exceeded several times, instead of by a part.
MOST_SIGMA0 = 2.0
# Probability by chance below which residuals that are too large are a finding.
BY_CHANCE = 0.001
# Fewer condition equations in excess let noise that is wrong by a quarter pass.
LEAST_REDUNDANCY = 30
# Part of the poses that may contradict the others.
MOST_EXCLUDED = 0.1
# Travel of the joint that turned most, below which all poses are the same.
LEAST_TRAVEL_DEG = 2.0
# Offsets of zeros, found by a search, that are reported.
LEAST_OFFSET_RAD = 1e-4
MOST_WEAK = 3
# Standard deviations between which 95 % of a normal distribution lie.
_TWO_SIDED = 1.96

_VARY = "Measure more poses, in more varied postures."
_CHECK_FILE = (
    "Take the arm file that the campaign was measured with; check its units, signs and "
    "zeros, and the features of the poses."
)


@dataclass(frozen=True, slots=True)
class SharedDeviation:
    """A deviation that certified radii share.

    Attributes:
        artefacts: Whose radii are certified.
        shift_mm: Of the contact along the normal, as of a larger probe radius.
        radius_mm: Of the probe, as stated.
        sigmas: By how many standard deviations the campaign fits better with it.
    """

    artefacts: tuple[str, ...]
    shift_mm: float
    radius_mm: float
    sigmas: float


@dataclass(frozen=True, slots=True)
class Direction:
    """A combination of parameters, in words, with its size at the probe and its cause.

    Attributes:
        why: Cause and remedy, without a full stop.
    """

    combination: str
    probe_mm: float
    why: str
    is_scale: bool = False


@dataclass(frozen=True, slots=True)
class PosesAside:
    """Poses that contradict the others: an artefact's, or those of a place.

    Attributes:
        where: In words, such as `on cone-2`.
        may_be: What that may mean, a sentence.
    """

    where: str
    n: int
    n_all: int
    may_be: str


@dataclass(frozen=True, slots=True)
class IdentificationEvidence:
    """Figures of an identification that its conditions look at.

    Attributes:
        reach_mm: Sum of the lengths of the links, as identified.
        size: That divided by the design's.
        changed: The parameter that is farthest from the design, and by how many of its
            plausible deviations.
        moving: What the last step would have changed, in words.
        samples_per_square: Of a stream, how many say as much as one.
        scale_touches: Which touches would determine the scale.
        offsets_rad: Of zeros that a search found, by joint.
        family: What the measurements contradict of the arm's family, in words; or "".
    """

    converged: bool
    redundancy: int
    sigma0: float
    test: GlobalTest
    noise_stated: bool
    samples_per_square: float
    rms_mm: float
    reach_mm: float
    size: float
    changed: tuple[str, float]
    travel_deg: float
    moving: str
    n_free: int
    n_poses: int
    n_excluded: int
    n_oriented: int
    n_turned: int
    certificates: Sequence[ContradictedCertificate]
    shared: SharedDeviation | None
    undetermined: Sequence[Direction]
    weak: Sequence[Direction]
    lost: Sequence[PosesAside]
    clusters: Sequence[PosesAside]
    scale_touches: str
    wrong_signs: Sequence[str]
    offsets_rad: Mapping[str, float]
    family: str


Finding = Established | Sequence[Shortfall]


def _bad(text: str, remedy: str, **values: Any) -> list[Shortfall]:
    return [Shortfall(text, remedy, values, State.BAD)]


def _converged(evidence: IdentificationEvidence) -> Finding:
    if evidence.converged:
        return Established()
    text = "The adjustment did not converge: none of these figures may be used."
    values = {"rms_mm": evidence.rms_mm, "redundancy": evidence.redundancy}
    if evidence.travel_deg < LEAST_TRAVEL_DEG:
        same = (
            f"{text} All poses are nearly the same: no joint turned by more than "
            f"{evidence.travel_deg:.2g} degrees."
        )
        return _bad(same, "Measure in varied postures.", travel_deg=evidence.travel_deg)
    if evidence.redundancy <= 0:
        more = f"{text} There are no more equations than unknowns (redundancy 0)."
        return _bad(more, "Measure more poses.", **values)
    if evidence.rms_mm > MOST_MISCLOSURE * evidence.reach_mm:
        left = f"{text} Misclosures of {length_mm(evidence.rms_mm)} are left."
        return _bad(left, _CHECK_FILE, **values)
    steps = (
        f"{text} Its steps do not become small, although misclosures of "
        f"{length_mm(evidence.rms_mm)} only are left: the poses hardly determine "
        f"{evidence.moving}."
    )
    hold = "Hold some of these (--hold), or measure more and more varied postures."
    return _bad(steps, hold, **values)


def _explained(evidence: IdentificationEvidence) -> Finding:
    limit_mm = MOST_MISCLOSURE * evidence.reach_mm
    values = {
        "rms_mm": evidence.rms_mm,
        "limit_mm": limit_mm,
        "reach_mm": evidence.reach_mm,
    }
    if evidence.rms_mm <= limit_mm:
        return Established(values)
    text = (
        f"The model does not explain the measurements at all: misclosures of "
        f"{length_mm(evidence.rms_mm)} are left, more than "
        f"{100.0 * MOST_MISCLOSURE:g} % of the arm's {length_mm(evidence.reach_mm)}. "
        "The arm file may be another arm's."
    )
    return _bad(text, _CHECK_FILE, **values)


def _same_size(evidence: IdentificationEvidence) -> Finding:
    if LEAST_SIZE < evidence.size < MOST_SIZE:
        return Established({"size": evidence.size})
    text = (
        f"The identified arm is {evidence.size:.3g} times as large as its design: no "
        "arm is built so far off, and an arm that shrinks fits everything."
    )
    return _bad(text, _CHECK_FILE, size=evidence.size)


def _like_design(evidence: IdentificationEvidence) -> Finding:
    name, deviations = evidence.changed
    values = {"parameter": name, "deviations": deviations}
    if deviations <= MOST_DEVIATION:
        return Established(values)
    text = (
        f"The identified arm is not like its design: {name} is off by {deviations:.0f} "
        "times what is plausible. The arm file may be another arm's, or the arm was "
        "rebuilt."
    )
    return [Shortfall(text, "Compare the identified links with the arm.", values)]


def _redundant(evidence: IdentificationEvidence) -> Finding:
    if evidence.redundancy <= 0:
        text = (
            "There are no more equations than unknowns (redundancy 0): nothing checks "
            "this result."
        )
        return _bad(text, "Measure more poses.", redundancy=evidence.redundancy)
    unseen = (
        _TWO_SIDED / (2.0 * evidence.redundancy / evidence.samples_per_square) ** 0.5
    )
    values = {"redundancy": evidence.redundancy, "unseen_part": unseen}
    if evidence.redundancy >= LEAST_REDUNDANCY:
        return Established(values)
    text = (
        f"A redundancy of {evidence.redundancy} is a weak check: noise that is wrong "
        f"by less than about {100.0 * unseen:.0f} % would not be noticed."
    )
    return [Shortfall(text, "Measure more poses.", values)]


def _scaled(evidence: IdentificationEvidence) -> Finding:
    lost = [entry for entry in evidence.undetermined if entry.is_scale]
    if not lost:
        return Established()
    text = (
        "The scale of the arm is undetermined: no length is known in this campaign. If "
        "the design is off by a plausible deviation, the probe is off by "
        f"{length_mm(lost[0].probe_mm)}."
    )
    return _bad(text, evidence.scale_touches, probe_mm=lost[0].probe_mm)


def _determined(evidence: IdentificationEvidence) -> Finding:
    missing = [entry for entry in evidence.undetermined if not entry.is_scale]
    if not missing:
        return Established({"n_free": evidence.n_free})
    return [
        Shortfall(
            f"Undetermined: {entry.combination}. If the design is off by a plausible "
            f"deviation there, the probe is off by {length_mm(entry.probe_mm)} (root "
            "mean square over the arm's reach).",
            f"Cause and remedy: {entry.why}.",
            {"combination": entry.combination, "probe_mm": entry.probe_mm},
        )
        for entry in missing
    ]


def _well_determined(evidence: IdentificationEvidence) -> Finding:
    if not evidence.weak:
        return Established()
    shortfalls = [
        Shortfall(
            f"Poorly determined: {entry.combination}, {length_mm(entry.probe_mm)} at "
            "the probe.",
            f"Cause and remedy: {entry.why}.",
            {"combination": entry.combination, "probe_mm": entry.probe_mm},
        )
        for entry in evidence.weak[:MOST_WEAK]
    ]
    n_more = len(evidence.weak) - MOST_WEAK
    if n_more > 0:
        text = f"{counted(n_more, 'more combination')} of parameters poorly determined."
        shortfalls.append(Shortfall(text, _VARY, {"n_more": n_more}))
    return shortfalls


def _certificates_agree(evidence: IdentificationEvidence) -> Finding:
    if not evidence.certificates:
        return Established()
    return [_contradicted(entry) for entry in evidence.certificates]


def _contradicted(entry: ContradictedCertificate) -> Shortfall:
    text = (
        f"The certificate of {entry.artefact} contradicts everything else by "
        f"{entry.sigmas:.3g} sigma: it says {entry.length.removesuffix('_mm')} "
        f"{entry.certified_mm:.10g} mm, the measurements {entry.value_mm:.4f} ± "
        f"{entry.std_mm:.4f} mm. It was left out."
    )
    remedy = "Correct the campaign file and identify again."
    if entry.or_else:
        rivals = " or ".join(entry.or_else)
        text += (
            f" It may as well be {rivals} that is wrong: the measurements cannot tell."
        )
        remedy = "Find out which it is, correct the files and identify again."
    values = {
        "artefact": entry.artefact,
        "length": entry.length,
        "certified_mm": entry.certified_mm,
        "measured_mm": entry.value_mm,
        "std_mm": entry.std_mm,
        "sigmas": entry.sigmas,
        "rivals": list(entry.or_else),
    }
    return Shortfall(text, remedy, values, State.BAD)


def _radii_agree(evidence: IdentificationEvidence) -> Finding:
    shared = evidence.shared
    if shared is None:
        return Established()
    sense = "larger" if shared.shift_mm > 0.0 else "smaller"
    text = (
        f"The certified radii of {', '.join(shared.artefacts)} are all {sense} as "
        f"measured, by {1000.0 * abs(shared.shift_mm):.1f} µm: they have one cause "
        f"({shared.sigmas:.3g} sigma), and no certificate is to blame. The probe's "
        f"radius is not the stated {shared.radius_mm:.10g} mm but "
        f"{shared.radius_mm + shared.shift_mm:.4f} mm, or the contact is late or bends "
        "the stylus by as much (pretravel, force). The certificates took part, with "
        "this shift."
    )
    remedy = (
        "Calibrate the probe's radius on a sphere, with the force of measuring; look "
        "with traverse diagnose whether the stylus bends."
    )
    values = {
        "artefacts": list(shared.artefacts),
        "shift_mm": shared.shift_mm,
        "probe_radius_mm": shared.radius_mm + shared.shift_mm,
        "sigmas": shared.sigmas,
    }
    return [Shortfall(text, remedy, values)]


def _noise_explains(evidence: IdentificationEvidence) -> Finding:
    """Compare residuals with the noise: too large is a fault, too small a remark."""
    p_value = evidence.test.p_value
    values = {
        "sigma0": evidence.sigma0,
        "redundancy": evidence.redundancy,
        "p_value": p_value,
    }
    if evidence.test.noise_estimated:
        text = (
            "No noise is stated in the campaign: it was estimated from the same "
            "residuals, so that nothing tests whether the model fits."
        )
        remedy = (
            "Give [noise] in campaign.toml; compare the estimated noise with what "
            "encoders and contacts should do."
        )
        return [Shortfall(text, remedy, values)]
    if evidence.redundancy <= 0 or p_value is None:
        return []
    if evidence.test.passed or evidence.sigma0 <= 1.0:
        return Established(values)
    if not evidence.noise_stated:
        text = (
            "The campaign does not state its noise, so usual figures were assumed, and "
            f"the residuals are {evidence.sigma0:.3g} times as large: the redundancy "
            "is too small to estimate the noise."
        )
        remedy = "Measure more poses, or state [noise] in campaign.toml."
        return [Shortfall(text, remedy, values)]
    text = (
        f"The residuals are {evidence.sigma0:.3g} times as large as the stated noise "
        f"explains (p = {probability(p_value)}): either the noise is stated too small, "
        "or the arm does something that axes and links do not describe. All standard "
        "deviations are scaled by sigma0."
    )
    if p_value > BY_CHANCE:
        text += f" By chance {100.0 * p_value:.1g} % of campaigns are as far off."
    remedy = "Look for a pattern with traverse diagnose."
    state = State.BAD if evidence.sigma0 > MOST_SIGMA0 else State.DOUBT
    return [Shortfall(text, remedy, values, state)]


def _artefacts_agree(evidence: IdentificationEvidence) -> Finding:
    return [
        Shortfall(
            f"{entry.where} lost {entry.n} of {entry.n_all} poses, more than a fifth: "
            f"{entry.may_be}",
            "Check its features, lengths and place during the measurement, and which "
            "parameters are held.",
            {"artefact": entry.where, "n_lost": entry.n, "n": entry.n_all},
        )
        for entry in evidence.lost
    ] or Established()


def _no_clusters(evidence: IdentificationEvidence) -> Finding:
    return [
        Shortfall(
            f"{entry.n} poses that contradict the others lie together, among "
            f"{entry.n_all} {entry.where}: {entry.may_be}",
            "Look for it with traverse diagnose.",
            {"where": entry.where, "n_excluded": entry.n, "n": entry.n_all},
        )
        for entry in evidence.clusters
    ] or Established()


def _few_excluded(evidence: IdentificationEvidence) -> Finding:
    values = {"n_excluded": evidence.n_excluded, "n": evidence.n_poses}
    if evidence.n_excluded <= MOST_EXCLUDED * evidence.n_poses:
        return Established(values)
    text = f"{evidence.n_excluded} of {evidence.n_poses} poses contradict the others."
    return [Shortfall(text, "Find out why before the arm is used.", values)]


def _orientations_agree(evidence: IdentificationEvidence) -> Finding:
    values = {"n_excluded": evidence.n_turned, "n": evidence.n_oriented}
    if evidence.n_turned <= MOST_EXCLUDED * evidence.n_oriented:
        return Established(values)
    text = (
        f"{evidence.n_turned} of {evidence.n_oriented} orientations contradict the "
        "positions and were left out."
    )
    remedy = (
        "Check the order of the quaternions' components (w, x, y, z), the frame that "
        "they are in, and that the instrument's probe stayed as it was mounted."
    )
    return [Shortfall(text, remedy, values)]


def _file_fits(evidence: IdentificationEvidence) -> Finding:
    shortfalls = [
        Shortfall(
            f"The arm file as given did not fit: {joint} turns the other way. It was "
            "identified with the other sense, by an axis that points the other way.",
            f"Look which way the encoder of {joint} counts; the identified arm file "
            "has its axis reversed, and needs no other sign.",
            {"joint": joint},
        )
        for joint in evidence.wrong_signs
    ]
    far = {
        joint: rad
        for joint, rad in evidence.offsets_rad.items()
        if abs(rad) > LEAST_OFFSET_RAD
    }
    if far:
        offsets = ", ".join(f"{joint} by {rad:+.4f} rad" for joint, rad in far.items())
        text = f"The arm file as given did not fit at all; other zeros do: {offsets}."
        values = {f"{joint}_offset_rad": rad for joint, rad in far.items()}
        shortfalls.append(Shortfall(text, "Check the arm file.", values))
    return shortfalls or Established()


def _family_agrees(evidence: IdentificationEvidence) -> Finding:
    if not evidence.family:
        return Established()
    return [Shortfall(evidence.family, "Compare the arm with its family.")]


CONDITIONS: tuple[Condition[IdentificationEvidence], ...] = (
    Condition("converged", "the adjustment converged", _converged),
    Condition("fit", "the model explains the measurements", _explained),
    Condition("size", "the arm is as large as its design", _same_size),
    Condition("design", "no parameter is far from the design", _like_design),
    Condition("redundancy", "there are equations that check the result", _redundant),
    Condition("scale", "the scale of the arm is known", _scaled),
    Condition("certificates", "no certificate is contradicted", _certificates_agree),
    Condition("radii", "certified radii are as measured", _radii_agree),
    Condition("arm_file", "signs and zeros of the arm file fit", _file_fits),
    Condition("noise", "the stated noise explains the residuals", _noise_explains),
    Condition("artefacts", "no artefact lost many poses", _artefacts_agree),
    Condition("clusters", "excluded poses do not lie together", _no_clusters),
    Condition("determined", "all free parameters are determined", _determined),
    Condition("weak", "all free parameters are determined well", _well_determined),
    Condition("family", "the arm is of its family", _family_agrees),
    Condition("excluded", "few poses contradict the others", _few_excluded),
    Condition("orientations", "few orientations are left out", _orientations_agree),
)

# A bad reason of these codes: an arm file of the result might be measured with.
_NO_ARM_FILE = frozenset({"converged", "fit", "size", "redundancy", "scale"})


# What can be said of an adjustment that did not converge.
_WITHOUT_FIGURES = frozenset({"converged", "certificates", "arm_file", "artefacts"})


@dataclass(frozen=True, slots=True)
class IdentificationOutcome:
    """What an identification concludes.

    Attributes:
        title: In a few words.
        writes_arm: Whether an arm file may be made of it.
    """

    outcome: Outcome
    title: str
    writes_arm: bool


def identification_outcome(evidence: IdentificationEvidence) -> IdentificationOutcome:
    """Judge an identification by its table of conditions."""
    table = CONDITIONS
    if not evidence.converged:
        # No figure of it may be used, for a reason either.
        table = tuple(
            condition for condition in CONDITIONS if condition.code in _WITHOUT_FIGURES
        )
    outcome = judge(table, evidence)
    bad = {entry.code for entry in outcome.reasons if entry.state is State.BAD}
    return IdentificationOutcome(
        outcome, _title(outcome, bad, evidence), not bad & _NO_ARM_FILE
    )


def _title(outcome: Outcome, bad: set[str], evidence: IdentificationEvidence) -> str:
    titles = {
        "converged": "Not identified",
        "fit": "The model does not explain the measurements",
        "size": "Not an arm of this design",
        "redundancy": "Unchecked: no redundancy",
        "scale": "The scale of the arm is undetermined",
        "certificates": "A certificate contradicts the measurements",
        "noise": "The model does not explain the measurements",
    }
    for code, title in titles.items():
        if code in bad:
            return title
    if outcome.state is State.GOOD:
        return "Identified"
    p_value = evidence.test.p_value
    if "noise" in outcome.codes and p_value is not None and p_value < BY_CHANCE:
        return "Identified; the residuals exceed the stated noise"
    if evidence.undetermined:
        count = counted(len(evidence.undetermined), "combination")
        largest = length_mm(max(entry.probe_mm for entry in evidence.undetermined))
        verb = "is" if len(evidence.undetermined) == 1 else "are"
        return (
            f"Identified in part: {count} of parameters {verb} undetermined, {largest} "
            "at the probe"
        )
    return "Identified, with reservations"
