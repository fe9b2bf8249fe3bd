"""Simulated arms that are tested by ISO 10360-12, and their true figures."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.trials.lines import Line
from traverse.kinematics.arm_file.arm import Arm, read_arm
from traverse.kinematics.fits import fit_sphere
from traverse.kinematics.model.forward import probe_centre
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.lab.acceptance.budget import Budget
from traverse.lab.acceptance.conformity import Figure, LengthError, Verdict, decision_of
from traverse.lab.acceptance.limits import Limits, Mpe, Standards
from traverse.lab.acceptance.procedures.length_tests import (
    AGAIN,
    MOST_SETS,
    length_names,
    length_test,
)
from traverse.lab.acceptance.procedures.lengths import SET
from traverse.lab.acceptance.standards import verified
from traverse.lab.artefacts import ARTEFACT_KINDS
from traverse.lab.artefacts.artefact import EXACT_MM
from traverse.lab.measured_points.measurement import (
    ArtefactTouches,
    Measurement,
    reach_of,
)
from traverse.simulator.arm.truth import Deviations, true_arm
from traverse.simulator.campaigns import NoiseTable
from traverse.simulator.campaigns.acceptance.poses import (
    acceptance_poses,
    drawn_acceptance,
    touched_by,
)
from traverse.simulator.campaigns.campaign import SimulatedCampaign, StatedArtefact
from traverse.simulator.campaigns.pose_set import PoseSet
from traverse.strict_toml.reader import tuples_for_lists

ARM = Path(__file__).parent.parent.parent / "cli" / "demo_data" / "arm.toml"
STANDARD = "iso10360-12"
STD_MM = 0.0007
EXPANSION_PER_C = 11.5e-6
EXPANSION_LIMIT_PER_C = 1e-6
TEMPERATURE_STD_C = 0.1
# The thermometer's deviation is the scatter of so many readings less one.
TEMPERATURE_DEGREES = 4
FIXTURE_STD_MM = 0.0004
REFERENCE_C, WARM_C = 18.0, 20.0
NOISE = NoiseTable(encoder_rad=3e-6, contact_mm=0.003)
LINKS_MM, AXES_RAD = 0.004, 3e-6
NEAR_U = 3.0  # how far a limit is from the true figure, at most
FIGURES = ("p_size", "e_uni")
RULES = ("simple", "1.65", "2.0")


@dataclass(frozen=True, slots=True)
class Tested:
    """One arm.

    Attributes:
        true_mm: Its figures by exact standards, by key.
        expanded_mm: Their stated U, by key; of 95.45 %.
        limit_mm: A limit near each, by key.
        procedure: Verdict on E_UNI with the ten repeats of the standard, by rule.
        lengths: Every measured length: true error, found error, u, U.
        counted: Size at the location that P_SIZE is of: true, found, U.
    """

    true_mm: dict[str, float]
    found_mm: dict[str, float]
    standard_mm: dict[str, float]
    expanded_mm: dict[str, float]
    limit_mm: dict[str, float]
    procedure: dict[str, Verdict]
    lengths: tuple[tuple[float, float, float, float], ...]
    counted: tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """One measured arm, in a laboratory with standards and thermometer of its own.

    Attributes:
        poses: Of the standards, touched by this arm.
        warm_c: As the thermometer says; it is 20 °C.
        temperature_std_c: Stated, of five readings.
        per_c: True coefficient of expansion of its standards.
    """

    seed: int
    poses: PoseSet
    drawn: SimulatedCampaign
    warm_c: float
    temperature_std_c: float
    per_c: float
    rng: np.random.Generator


def drawn_arm(seed: int) -> Case:
    """Draw an arm; its errors are half to one and a half of the usual ones."""
    arm, poses, _ = _prepared()
    rng = np.random.default_rng([seed, 0xACC])
    scale = rng.uniform(0.5, 1.5)
    deviations = Deviations(links_mm=scale * LINKS_MM, axes_rad=scale * AXES_RAD)
    touched = touched_by(poses, true_arm(arm, deviations, seed))
    warm_c = WARM_C + TEMPERATURE_STD_C * float(rng.standard_normal())
    scatter = np.sqrt(rng.chisquare(TEMPERATURE_DEGREES) / TEMPERATURE_DEGREES)
    std_c = float(TEMPERATURE_STD_C * scatter)
    off_per_c = float(rng.uniform(-EXPANSION_LIMIT_PER_C, EXPANSION_LIMIT_PER_C))
    drawn = drawn_acceptance(touched, seed)
    return Case(seed, touched, drawn, warm_c, std_c, EXPANSION_PER_C + off_per_c, rng)


def tested(case: Case) -> Line:
    arm, _, exact = _prepared()
    drawn = case.drawn
    limits = limits_of("1.65", case.temperature_std_c)
    true = verified([_measured(arm, drawn, exact, WARM_C)], STANDARD, limits)
    at_reference = 1.0 - case.per_c * (WARM_C - REFERENCE_C)
    artefacts = [_scaled(each, at_reference) for each in drawn.campaign.artefacts]
    measured = _measured(arm, drawn, artefacts, case.warm_c, REFERENCE_C)
    measured = _shaken(measured, case.rng)
    stated = verified([measured], STANDARD, limits)
    true_mm, standard_mm = (
        _values(true.figures),
        {
            figure.key: _stated(figure.budget.standard_mm)
            for figure in stated.figures
            if figure.key in FIGURES
        },
    )
    limit_mm = {
        key: true_mm[key] + standard_mm[key] * float(case.rng.uniform(-NEAR_U, NEAR_U))
        for key in FIGURES
    }
    outcome = Tested(
        true_mm,
        _values(stated.figures),
        standard_mm,
        {
            figure.key: _expanded(figure.budget, limits)
            for figure in stated.figures
            if figure.key in FIGURES
        },
        limit_mm,
        {rule: _procedure(case, measured, rule, limit_mm) for rule in RULES},
        tuple(_paired(true.lengths, stated.lengths, limits)),
        _counted(true.figures[0], stated.figures[0], limits),
    )
    return {"outcome": asdict(outcome)}


def _scaled(artefact: StatedArtefact, factor: float) -> StatedArtefact:
    """State the lengths of a standard at another temperature."""
    table = dict(artefact.table)
    if "radius_mm" in table:
        table["radius_mm"] *= factor
    if "points_mm" in table:
        table["points_mm"] = {
            name: (factor * np.array(point_mm)).tolist()
            for name, point_mm in table["points_mm"].items()
        }
    return replace(artefact, table=table)


def _shaken(measured: Measurement, rng: np.random.Generator) -> Measurement:
    """Let standards yield: ends of lengths between touches, spheres in diameter."""
    touched = {}
    for name, before in measured.touched.items():
        places_mm = before.places_mm.copy()
        if not name.startswith("uni-"):
            outwards = places_mm - fit_sphere(places_mm).centre_mm
            larger_mm = 0.5 * FIXTURE_STD_MM * float(rng.standard_normal())
            outwards /= np.linalg.norm(outwards, axis=1)[:, np.newaxis]
            places_mm += larger_mm * outwards
            touched[name] = replace(before, places_mm=places_mm)
            continue
        way = places_mm[1] - places_mm[0]
        ends = np.array(before.features) == before.features[1]
        moved_mm = FIXTURE_STD_MM * rng.standard_normal(int(ends.sum()))
        places_mm[ends] += moved_mm[:, np.newaxis] * way / np.linalg.norm(way)
        touched[name] = replace(before, places_mm=places_mm)
    return replace(measured, touched={**measured.touched, **touched})


def _procedure(
    case: Case, measured: Measurement, rule: str, limit_mm: dict[str, float]
) -> Verdict:
    """Decide on E_UNI, with ten repeats of outliers if the rule allows them."""
    poses, seed = case.poses, case.seed
    limits = limits_of(rule, case.temperature_std_c, e_uni_mm=limit_mm["e_uni"])
    verdict, lengths = _e_uni(measured, limits)
    bad = {
        name: sum(
            decision_of(e.error_mm, e.limit_mm or 0.0, e.standard_mm, limits).verdict
            != "accept"
            for e in lengths
            if e.artefact == name
        )
        for name in length_names("uni")
    }
    outside = [name for name, count in bad.items() if count]
    if not outside or len(outside) > MOST_SETS or max(bad.values()) > 1:
        return verdict
    touched = dict(measured.touched)
    geometry = geometry_from_arm(poses.arm)
    for draw in range(-(-AGAIN // SET)):
        campaign = drawn_acceptance(poses, 1_000_000 + 10 * seed + draw).campaign
        places_mm = probe_centre(geometry, campaign.readings_rad)
        for name in outside:
            rows = np.flatnonzero(campaign.artefact == name)
            before = touched[name]
            room = 2 * (SET + AGAIN) - len(before)
            touched[name] = ArtefactTouches(
                np.concatenate([before.places_mm, places_mm[rows][:room]]),
                (*before.features, *campaign.feature[rows].tolist()[:room]),
                np.full(len(before) + min(room, len(rows)), before.temperature_c[0]),
                np.full(len(before) + min(room, len(rows)), before.tip_mm[0]),
            )
    return _e_uni(replace(measured, touched=touched), limits)[0]


def _e_uni(measured: Measurement, limits: Limits) -> tuple[Verdict, list[LengthError]]:
    parts = list(length_test(measured, "e_uni", limits))
    (figure,) = [part for part in parts if isinstance(part, Figure)]
    if figure.decision is None:
        raise ValueError("E_UNI without a limit")
    return figure.decision.verdict, [p for p in parts if isinstance(p, LengthError)]


_PREPARED: list[tuple[Arm, PoseSet, tuple[StatedArtefact, ...]]] = []


def _prepared() -> tuple[Arm, PoseSet, tuple[StatedArtefact, ...]]:
    """Find places and postures once per process."""
    if not _PREPARED:
        arm = read_arm(ARM)
        poses = acceptance_poses(arm, STANDARD, 1, noise=NOISE, std_mm=STD_MM)
        exact = acceptance_poses(arm, STANDARD, 1, noise=NOISE, std_mm=0.0)
        exact_artefacts = drawn_acceptance(exact, 1).campaign.artefacts
        _PREPARED.append((arm, poses, exact_artefacts))
    return _PREPARED[0]


def limits_of(
    rule: str, temperature_std_c: float = TEMPERATURE_STD_C, **mpe: float
) -> Limits:
    return Limits(
        schema="traverse/acceptance-limits/1",
        decision="simple" if rule == "simple" else "iso14253-1",
        guard_factor=1.65 if rule == "simple" else float(rule),
        standards=Standards(
            temperature_std_c=temperature_std_c,
            temperature_degrees=TEMPERATURE_DEGREES,
            fixture_std_mm=FIXTURE_STD_MM,
            form_mm=EXACT_MM,
        ),
        mpe=Mpe(**mpe),
    )


def _measured(
    arm: Arm,
    drawn: SimulatedCampaign,
    artefacts: Sequence[StatedArtefact],
    warm_c: float,
    reference_c: float = WARM_C,
) -> Measurement:
    """Compute places with the arm file; standards are of steel."""
    campaign = drawn.campaign
    places_mm = probe_centre(geometry_from_arm(arm), campaign.readings_rad)
    steel = {
        "expansion_per_c": EXPANSION_PER_C,
        "expansion_std_per_c": EXPANSION_LIMIT_PER_C / 3.0**0.5,
        "reference_temperature_c": reference_c,
    }
    standards = {}
    for entry in artefacts:
        table = {"id": entry.id, "kind": entry.kind, **entry.table, **steel}
        kind = ARTEFACT_KINDS[entry.kind]
        standards[entry.id] = kind.model_validate(tuples_for_lists(table))
    touched = {}
    for name in standards:
        rows = np.flatnonzero(campaign.artefact == name)
        touched[name] = ArtefactTouches(
            places_mm[rows],
            tuple(campaign.feature[rows].tolist()),
            np.full(len(rows), warm_c),
            np.full(len(rows), arm.probe.radius_mm),
        )
    shoulder_mm, reach_mm = reach_of(arm)
    return Measurement(standards, touched, shoulder_mm, reach_mm)


def _stated(standard_mm: float | None) -> float:
    if standard_mm is None:
        raise ValueError("the drawn standards state theirs")
    return standard_mm


def _expanded(budget: Budget, limits: Limits) -> float:
    factor = budget.coverage_factor(limits.coverage_probability)
    return factor * _stated(budget.standard_mm)


def _values(figures: Sequence[Figure]) -> dict[str, float]:
    return {figure.key: abs(figure.value_mm) for figure in figures}


def _counted(true: Figure, found: Figure, limits: Limits) -> tuple[float, float, float]:
    name, size_mm = max(found.parts, key=lambda part: abs(part[1]))
    return dict(true.parts)[name], size_mm, _expanded(found.budget, limits)


def _paired(
    true: Sequence[LengthError], measured: Sequence[LengthError], limits: Limits
) -> Iterator[tuple[float, float, float, float]]:
    for error, other in zip(true, measured, strict=True):
        expanded_mm = _expanded(other.budget, limits)
        yield error.error_mm, other.error_mm, _stated(other.standard_mm), expanded_mm


def drawn_again(test: int) -> SimulatedCampaign:
    arm, poses, _ = _prepared()
    deviations = Deviations(links_mm=LINKS_MM, axes_rad=AXES_RAD)
    return drawn_acceptance(touched_by(poses, true_arm(arm, deviations, 1)), test)


def tested_again(drawn: SimulatedCampaign) -> Line:
    arm, _, exact = _prepared()
    measured = _measured(arm, drawn, exact, WARM_C)
    return {
        "outcome": _values(verified([measured], STANDARD, limits_of("1.65")).figures)
    }
