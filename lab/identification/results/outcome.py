"""What must be established before an identified arm is good, and before it is written.

Strategy: an arm file is measured with, so that one is written only where the campaign
could have shown that it is wrong (redundancy), where it explains the measurements as an
arm of this design can, and where the scale of the arm is known. Everything else that is
not established leaves a file, and a result in doubt or bad that says so.
"""

from dataclasses import dataclass

import numpy as np

from traverse.lab.artefacts.artefact import Artefact
from traverse.lab.identification.results.agreement import ALIKE, KEPT, STATED
from traverse.lab.identification.results.result import Identification
from traverse.lab.identification.results.undetermined import combination
from traverse.lab.outcomes.base import (
    Condition,
    Established,
    Finding,
    Outcome,
    Shortfall,
    State,
    bad,
    doubt,
    judge,
)
from traverse.lab.outcomes.common_conditions import (
    like_design,
    may_be_measured_with,
    several_reaches,
)
from traverse.lab.report.quantities import length_mm, probability
from traverse.plurals import counted

# Misclosures, as a part of the arm's length, that no arm like the design leaves.
_MOST_MISCLOSURE = 0.005
# Factors between the design's length and the identified one that no arm is off by.
_LEAST_SIZE, _MOST_SIZE = 0.8, 1.25
# sigma0 beyond which stated noise is exceeded several times, instead of by a part.
_MOST_SIGMA0 = 2.0
# Probability by chance below which residuals that are too large are a finding.
_BY_CHANCE = 0.001
# Fewer condition equations in excess let noise that is wrong by a quarter pass.
_LEAST_REDUNDANCY = 30
# Travel of the joint that turned most, below which all poses are the same.
_LEAST_TRAVEL_DEG = 2.0
_MOST_WEAK = 3
# Standard deviations between which 95 % of a normal distribution lie.
_TWO_SIDED = 1.96
# Of the reach: a bar that is shorter carries little of a length.
_LONG_BAR = 0.66

_VARY = "Measure more poses, in more varied postures."
_CHECK_FILE = (
    "Take the arm file that the campaign was measured with; check its units, signs and "
    "zeros, and the features of the poses."
)


def _reaches_mm(result: Identification) -> tuple[float, float]:
    """Sum up the lengths of the links: of the identified arm, and of its design."""
    identified_mm = result.adjustment.state.arm.geometry.links_mm
    designed_mm = np.array([joint.link_mm for joint in result.design.joints])
    identified, designed = (
        float(np.sum(np.linalg.norm(links_mm, axis=1)))
        for links_mm in (identified_mm, designed_mm)
    )
    return identified, designed


def _misclosure_mm(result: Identification) -> float:
    """Size of misclosures: of the poses used, or the median of all if it is larger.

    Half of an artefact's poses may have been left out, and still nothing fit.
    """
    sizes_mm = np.sqrt(np.nansum(result.statistics.misclosures_mm**2, axis=1))
    return max(result.rms_after_mm, float(np.median(sizes_mm)))


def _converged(result: Identification) -> Finding:
    if result.converged:
        return Established()
    text = "The adjustment did not converge: none of these figures may be used."
    rms_mm = _misclosure_mm(result)
    values = {"rms_mm": rms_mm, "redundancy": result.redundancy}
    travel_rad = np.ptp(result.campaign.poses.angles_rad, axis=0)
    travel_deg = float(np.degrees(np.max(travel_rad)))
    if travel_deg < _LEAST_TRAVEL_DEG:
        same = (
            f"{text} All poses are nearly the same: no joint turned by more than "
            f"{travel_deg:.2g} degrees."
        )
        return bad(same, "Measure in varied postures.", {"travel_deg": travel_deg})
    if result.redundancy <= 0:
        more = f"{text} There are no more equations than unknowns (redundancy 0)."
        return bad(more, "Measure more poses.", values)
    if rms_mm > _MOST_MISCLOSURE * _reaches_mm(result)[0]:
        left = f"{text} Misclosures of {length_mm(rms_mm)} are left."
        return bad(left, _CHECK_FILE, values)
    steps = (
        f"{text} Its steps do not become small, although misclosures of "
        f"{length_mm(rms_mm)} only are left: the poses hardly determine "
        f"{combination(result.moving)}."
    )
    hold = "Hold some of these (--hold), or measure more and more varied postures."
    return bad(steps, hold, values)


def _explained(result: Identification) -> Finding:
    rms_mm, reach_mm = _misclosure_mm(result), _reaches_mm(result)[0]
    limit_mm = _MOST_MISCLOSURE * reach_mm
    values = {"rms_mm": rms_mm, "limit_mm": limit_mm, "reach_mm": reach_mm}
    if rms_mm <= limit_mm:
        return Established(values)
    text = (
        f"The model does not explain the measurements at all: misclosures of "
        f"{length_mm(rms_mm)} are left, more than {100.0 * _MOST_MISCLOSURE:g} % of "
        f"the arm's {length_mm(reach_mm)}. The arm file may be another arm's."
    )
    return bad(text, _CHECK_FILE, values)


def _same_size(result: Identification) -> Finding:
    identified_mm, designed_mm = _reaches_mm(result)
    size = identified_mm / max(designed_mm, 1e-9)
    if _LEAST_SIZE < size < _MOST_SIZE:
        return Established({"size": size})
    text = (
        f"The identified arm is {size:.3g} times as large as its design: no arm is "
        "built so far off, and an arm that shrinks fits everything."
    )
    return bad(text, _CHECK_FILE, {"size": size})


def _like_design(result: Identification) -> Finding:
    tolerances = result.adjustment.network.parameters.free_tolerances
    changes = np.array([entry.value for entry in result.parameters]) / tolerances
    names = [entry.name for entry in result.parameters]
    return like_design(dict(zip(names, changes.tolist(), strict=True)))


def _redundant(result: Identification) -> Finding:
    redundancy, serial = result.redundancy, result.serial_noise
    if redundancy <= 0:
        text = (
            "There are no more equations than unknowns (redundancy 0): nothing checks "
            "this result."
        )
        return bad(text, "Measure more poses.", {"redundancy": redundancy})
    samples_per_square = 1.0 if serial is None else serial.samples_per_square
    unseen = _TWO_SIDED / (2.0 * redundancy / samples_per_square) ** 0.5
    values = {"redundancy": redundancy, "unseen_part": unseen}
    if redundancy >= _LEAST_REDUNDANCY:
        return Established(values)
    text = (
        f"A redundancy of {redundancy} is a weak check: noise that is wrong by less "
        f"than about {100.0 * unseen:.0f} % would not be noticed."
    )
    return doubt(text, "Measure more poses.", values)


def _noise_explains(result: Identification) -> Finding:
    """Compare residuals with the noise: too large is a fault, too small a remark."""
    test, sigma0 = result.global_test, result.sigma0
    values = {
        "sigma0": sigma0,
        "redundancy": result.redundancy,
        "p_value": test.p_value,
    }
    if test.noise_estimated:
        text = (
            "No noise is stated in the campaign: it was estimated from the same "
            "residuals, so that nothing tests whether the model fits."
        )
        remedy = (
            "Give [noise] in campaign.toml; compare the estimated noise with what "
            "encoders and contacts should do."
        )
        return doubt(text, remedy, values)
    if result.redundancy <= 0 or test.p_value is None:
        return []
    if test.passed or sigma0 <= 1.0:
        return Established(values)
    if not result.campaign.states_noise:
        text = (
            "The campaign does not state its noise, so usual figures were assumed, and "
            f"the residuals are {sigma0:.3g} times as large: the redundancy is too "
            "small to estimate the noise."
        )
        remedy = "Measure more poses, or state [noise] in campaign.toml."
        return doubt(text, remedy, values)
    text = (
        f"The residuals are {sigma0:.3g} times as large as the stated noise explains "
        f"(p = {probability(test.p_value)}): either the noise is stated too small, or "
        "the arm does something that axes and links do not describe. All that noise "
        "does not explain counts as an error of the arm, whose standard deviations are "
        f"{result.variance_factor**0.5:.3g} times those of the stated noise."
    )
    if test.p_value > _BY_CHANCE:
        text += f" By chance {100.0 * test.p_value:.1g} % of campaigns are as far off."
    remedy = "Look for a pattern with traverse diagnose."
    state = State.BAD if sigma0 > _MOST_SIGMA0 else State.DOUBT
    return [Shortfall(text, remedy, values, state)]


def _scaled(result: Identification) -> Finding:
    lost = [entry for entry in result.undetermined if entry.is_scale]
    if not lost:
        return Established()
    text = (
        "The scale of the arm is undetermined: no length is known in this campaign. If "
        "the design is off by a plausible deviation, the probe is off by "
        f"{length_mm(lost[0].probe_mm)}."
    )
    touches = _scale_touches(result.campaign.artefacts, max(_reaches_mm(result)))
    return bad(text, touches, {"probe_mm": lost[0].probe_mm})


def _scale_touches(artefacts: tuple[Artefact, ...], reach_mm: float) -> str:
    """Say which touches of a campaign would make its scale known."""
    bar = (
        "a ball bar with a certified distance of its centres, "
        f"{_LONG_BAR * reach_mm:.0f} mm or longer, with five touches on each ball"
    )
    known = [entry.id for entry in artefacts if entry.kind in ("sphere", "ball_bar")]
    if known:
        return (
            f"Add a length standard: {bar}; or give the certified lengths of "
            f"{', '.join(known)} in campaign.toml."
        )
    return f"Add a length standard: {bar}; or hold the links where they are known."


def _determined(result: Identification) -> Finding:
    shortfalls = []
    for entry in result.undetermined:
        if entry.is_scale:
            continue
        names = combination(entry.direction)
        text = (
            f"Undetermined: {names}. If the design is off by a plausible deviation "
            f"there, the probe is off by {length_mm(entry.probe_mm)} (root mean square "
            "over the arm's reach)."
        )
        values = {"combination": names, "probe_mm": entry.probe_mm}
        remedy = f"Cause and remedy: {entry.why}."
        shortfalls.append(Shortfall(text, remedy, values))
    return shortfalls or Established({"n_free": len(result.parameters)})


def _well_determined(result: Identification) -> Finding:
    shortfalls = []
    for entry in result.weak[:_MOST_WEAK]:
        names = combination(entry.direction)
        text = f"Poorly determined: {names}, {length_mm(entry.probe_mm)} at the probe."
        values = {"combination": names, "probe_mm": entry.probe_mm}
        remedy = f"Cause and remedy: {entry.why}."
        shortfalls.append(Shortfall(text, remedy, values))
    n_more = len(result.weak) - _MOST_WEAK
    if n_more > 0:
        text = f"{counted(n_more, 'more combination')} of parameters poorly determined."
        shortfalls.append(Shortfall(text, _VARY, {"n_more": n_more}))
    return shortfalls or Established()


def _several_reaches(result: Identification) -> Finding:
    geometry = result.adjustment.state.arm.geometry
    return several_reaches(geometry, result.campaign.poses.angles_rad)


CONDITIONS: tuple[Condition[Identification], ...] = (
    Condition("converged", "the adjustment converged", _converged),
    Condition("fit", "the model explains the measurements", _explained),
    Condition("size", "the arm is as large as its design", _same_size),
    Condition("design", "no parameter is far from the design", _like_design),
    Condition("redundancy", "there are equations that check the result", _redundant),
    Condition("scale", "the scale of the arm is known", _scaled),
    *STATED,
    Condition("noise", "the stated noise explains the residuals", _noise_explains),
    *KEPT,
    Condition("determined", "all free parameters are determined", _determined),
    Condition("weak", "all free parameters are determined well", _well_determined),
    Condition("reach", "poses are at several reaches", _several_reaches),
    *ALIKE,
)

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


def outcome_of(result: Identification) -> IdentificationOutcome:
    table = CONDITIONS
    if not result.converged:
        # No figure of it may be used, for a reason either.
        table = tuple(
            condition for condition in CONDITIONS if condition.code in _WITHOUT_FIGURES
        )
    if not isinstance(_same_size(result), Established):
        # An arm that shrank or grew contradicts every certificate: none is to blame.
        table = tuple(entry for entry in table if entry.code != "certificates")
    outcome = judge(table, result)
    bad = {entry.code for entry in outcome.reasons if entry.state is State.BAD}
    return IdentificationOutcome(
        outcome, _title(outcome, bad, result), may_be_measured_with(outcome)
    )


def _title(outcome: Outcome, bad: set[str], result: Identification) -> str:
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
    p_value = result.global_test.p_value
    if "noise" in outcome.codes and p_value is not None and p_value < _BY_CHANCE:
        return "Identified; the residuals exceed the stated noise"
    if result.undetermined:
        count = counted(len(result.undetermined), "combination")
        largest = length_mm(max(entry.probe_mm for entry in result.undetermined))
        verb = "is" if len(result.undetermined) == 1 else "are"
        return (
            f"Identified in part: {count} of parameters {verb} undetermined, {largest} "
            "at the probe"
        )
    return "Identified, with reservations"
