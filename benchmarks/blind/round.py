"""One round of the blind test: hide, diagnose, compare."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from benchmarks.blind.detectable_sizes import SizeScale, noise_free_campaign, ruler
from benchmarks.blind.hidden.effects import EFFECT_KINDS, HiddenEffect
from benchmarks.blind.hidden.poses import (
    Hidden,
    drawn,
    drawn_round,
    played,
    pose_set,
    without_masses,
)
from benchmarks.blind.score import TrueTerm
from benchmarks.tools.handover import campaign_from_simulation
from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.holdout import split
from traverse.lab.diagnosis.diagnose import diagnose
from traverse.lab.diagnosis.holdout.comparison import compare_on_holdout
from traverse.lab.diagnosis.model.fit import fitted, with_effects
from traverse.lab.diagnosis.model.result import Diagnosis, DiagnosisOptions
from traverse.simulator.campaigns import (
    NoiseTable,
    PoseSet,
    SimulatedCampaign,
    draw_noise,
)

_TAG = 0x626C696E
# Between the seeds of the noise of two streams.
_APART = 1_000_000
# Draws of a kind's joint and direction before another round is drawn.
_DRAWS = 40
# Half of all effects of this size are detected.
_HARDLY_SEEN = 4.0


@dataclass(frozen=True, slots=True)
class Scenario:
    """How effects are hidden.

    Attributes:
        n_effects: number; 0 on clean data.
        size: of each, in sqrt(lambda).
        outside: no arm file can name them.
        serial_share: part of the noise that is correlated from pose to pose.
        stated_factor: stated over true noise.
        stream: scenarios of the same one share effects and noise, seed by seed.
    """

    name: str
    n_effects: int = 0
    size: float = 0.0
    outside: bool = False
    blunder_share: float = 0.0
    serial_share: float = 0.0
    stated_factor: float = 1.0
    stream: int = 0

    def noise(self, plain: NoiseTable) -> NoiseTable:
        changes = {
            "blunder_share": self.blunder_share,
            "serial_share": self.serial_share,
            "stated_factor": self.stated_factor,
        }
        return plain.model_copy(update=changes)


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """Hidden effects, and the input of the diagnosis.

    Attributes:
        scenario: how it was hidden.
        pose_seed: of the poses and of the diagnosis.
        truths: the same, for the score.
        likeness: share of each effect's signal that the most similar name of the
            library explains, 0 to 1.
        simulated: the measurements and their truth.
    """

    scenario: Scenario
    seed: int
    pose_seed: int
    hidden: tuple[Hidden, ...]
    truths: tuple[TrueTerm, ...]
    likeness: tuple[float, ...]
    arm: Arm
    simulated: SimulatedCampaign
    campaign: Campaign


def hide(arm: Arm, scenario: Scenario, seed: int) -> Case:
    """Draw effects, play them, measure.

    Args:
        arm: As in the arm file; masses are added where it has none.
        scenario: How to hide.
        seed: Of everything.
    """
    rng = np.random.default_rng([seed, scenario.stream, _TAG])
    while True:
        drawn_effects = drawn_round(
            rng, arm, scenario.n_effects, outside=scenario.outside
        )
        n_lengths = 2 if len(drawn_effects.poses.artefacts) > 5 else 1
        measure = _ruler(arm, drawn_effects.pose_seed, n_lengths)
        hidden = _drawn_sizes(rng, measure, drawn_effects.kinds, scenario)
        if len(hidden) == len(drawn_effects.kinds):
            break
    poses = played(drawn_effects.poses, hidden)
    noise = scenario.noise(poses.spec.noise)
    simulated = draw_noise(poses, seed + _APART * scenario.stream, noise)
    truths = tuple(truth_of(measure, effect) for effect in hidden)
    likeness = tuple(measure.likeness(effect) for effect in hidden)
    return Case(
        scenario,
        seed,
        drawn_effects.pose_seed,
        hidden,
        truths,
        likeness,
        poses.arm,
        simulated,
        campaign_from_simulation(simulated.campaign),
    )


def find(
    case: Case,
    progress: Callable[[str, float], None] | None = None,
    *,
    details: bool = False,
    knows_masses: bool = True,
) -> Diagnosis:
    """Diagnose a case.

    Args:
        case: only its campaign and arm file are used.
        progress: called with each step.
        details: compute everything that a report contains.
        knows_masses: its arm file states them.
    """
    options = DiagnosisOptions(seed=case.pose_seed, details=details)
    arm = case.arm if knows_masses else without_masses(case.arm)
    return diagnose(case.campaign, arm, options, progress)


def gap_of(case: Case, diagnosis: Diagnosis) -> tuple[float, float, float] | None:
    """Return the held-out mean squares before, after, and of the true effects' fit.

    Returns:
        None if no arm file can hold the true effects, or nothing was hidden.
    """
    entries = [entry.entry for entry in case.hidden if isinstance(entry, HiddenEffect)]
    if not entries or len(entries) < len(case.hidden):
        return None
    arm = with_effects(case.arm, tuple(entries))
    adjustment = fitted(case.campaign, arm, diagnosis.choosing).adjustment
    noise = diagnosis.all_terms.network.noise
    compared = diagnosis.held_out & ~diagnosis.blunders
    oracle = compare_on_holdout(adjustment, adjustment, compared, noise=noise).after
    first, last = (
        gap.without_blunders or gap
        for gap in (diagnosis.ledger[0].held_out, diagnosis.ledger[-1].held_out)
    )
    return first.chi2, last.chi2, oracle.chi2


@lru_cache(maxsize=16)
def _ruler(arm: Arm, pose_seed: int, n_lengths: int) -> SizeScale:
    poses: PoseSet = pose_set(arm, pose_seed, n_lengths)
    choosing, _ = split(noise_free_campaign(poses), pose_seed)
    return ruler(poses, poses.arm, choosing)


def _drawn_sizes(
    rng: np.random.Generator,
    measure: SizeScale,
    kinds: tuple[str, ...],
    scenario: Scenario,
) -> tuple[Hidden, ...]:
    """Draw one effect of each kind that the campaign can detect, if any."""
    hidden: list[Hidden] = []
    for kind in kinds:
        for _ in range(_DRAWS):
            effect = measure.sized(drawn(rng, measure.poses, kind), scenario.size)
            if effect is None or (scenario.outside and _has_a_name(measure, effect)):
                continue
            hidden.append(effect)
            break
    return tuple(hidden)


def _has_a_name(measure: SizeScale, hidden: Hidden) -> bool:
    """Return whether a name fits so well that the remainder is undetectable."""
    size = float(np.linalg.norm(measure.signal((hidden,))))
    left = size * np.sqrt(max(1.0 - measure.likeness(hidden) ** 2, 0.0))
    return bool(left < _HARDLY_SEEN)


def truth_of(measure: SizeScale, hidden: Hidden) -> TrueTerm:
    keys = hidden.keys
    return TrueTerm(
        identity=(
            hidden.kind,
            hidden.joint,
            keys.get("order"),
            keys.get("component"),
            keys.get("artefact"),
        ),
        sizes=hidden.estimable if isinstance(hidden, HiddenEffect) else {},
        aliases=measure.names_like(hidden),
        in_library=hidden.kind in EFFECT_KINDS,
    )
