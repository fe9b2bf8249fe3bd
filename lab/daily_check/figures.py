"""The figures of a daily check: a cone and a calibrated sphere, a few touches each."""

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.fits import PLAUSIBLE_MM, off_seat, spread_about_mean
from traverse.kinematics.uncertainty.joint_covariance import COVERAGE_FACTOR
from traverse.lab.acceptance.plan import CAMPAIGN, Plan, Step, campaign_text, plan_text
from traverse.lab.collection.plan import PLAN
from traverse.lab.measured_points.measurement import (
    ArtefactTouches,
    IncompleteError,
    Measurement,
    certified_sphere,
    copied_touches,
    fitted_sphere,
    reach_of,
)
from traverse.plurals import counted

FEWEST_CONE, FEWEST_SPHERE = 5, 9
SIZE_MM = 1.0
"""Tips and spheres that can be taken for one another differ by more in diameter."""
ASSUMED_MM = 0.2
"""Largest error of an arm of which nothing is stated."""
MOST_U = 2.5
"""Expanded uncertainties of a touch that no figure of an arm as stated exceeds.

Of ten touches the farthest from their mean, and of nine the range of their distances
from a sphere, is beyond that in one of a hundred checks.
"""


@dataclass(frozen=True, slots=True)
class FigureKind:
    """One of the figures.

    Attributes:
        assumed_mm: Permissible error where nothing is stated: beyond it is no base.
        plausible_mm: Beyond it not the arm is off, but something else was touched.
        like: Key of the figure of an acceptance test that it is beside.
    """

    key: str
    name: str
    definition: str
    positive: bool
    assumed_mm: float
    plausible_mm: float
    like: str


KINDS = (
    FigureKind(
        "spat_2s_mm",
        "articulation, 2 s",
        "cone: delta_i = |p_i - mean|; 2 s, s = sqrt(sum delta_i^2 / (n - 1))",
        True,
        2.0 * ASSUMED_MM,
        2.0 * PLAUSIBLE_MM,
        "spat_2s",
    ),
    FigureKind(
        "spat_max_mm",
        "articulation, largest",
        "cone: max delta_i",
        True,
        ASSUMED_MM,
        PLAUSIBLE_MM,
        "spat_max",
    ),
    FigureKind(
        "sphere_form_mm",
        "sphere, form",
        "least-squares sphere (c, r): max|p - c| - min|p - c|",
        True,
        ASSUMED_MM,
        PLAUSIBLE_MM,
        "p_form",
    ),
    FigureKind(
        "sphere_diameter_mm",
        "sphere, diameter less the calibrated one",
        "least-squares sphere: 2 (r - tip radius) - D_cal, corrected for expansion",
        False,
        ASSUMED_MM,
        SIZE_MM,
        "p_size",
    ),
)


@dataclass(frozen=True, slots=True)
class DailyCheckFigures:
    """Result of a check.

    Attributes:
        spat_2s_mm, spat_max_mm: Of the cone.
        sphere_form_mm: Of the sphere.
        sphere_diameter_mm: Its diameter less the calibrated one.
        n_cone, n_sphere: Touches of each.
        sphere_radius_mm: Calibrated.
        temperature_c: Mean of all touches; None where unknown.
        stated_mm: Expanded uncertainty (k = 2) of a touch, as the arm file and the
            campaign's noise state it; None where they do not.
    """

    spat_2s_mm: float
    spat_max_mm: float
    sphere_form_mm: float
    sphere_diameter_mm: float
    n_cone: int
    n_sphere: int
    sphere_radius_mm: float
    temperature_c: float | None
    stated_mm: float | None = None


def daily_check_figures(measured: Measurement) -> DailyCheckFigures:
    """Compute the figures of a campaign with one cone and one calibrated sphere.

    Raises:
        IncompleteError: Something is missing, there is more than one, or a figure is
            not plausible.
    """
    by_kind = {
        kind: [name for name, a in measured.artefacts.items() if a.kind == kind]
        for kind in ("cone", "sphere")
    }
    for kind, names in by_kind.items():
        if len(names) != 1:
            raise IncompleteError(
                f"the campaign has {len(names)} artefacts of the kind {kind} "
                f"({', '.join(names) or 'none'}), expected one"
            )
    (cone,), (ball,) = by_kind.values()
    sphere = certified_sphere(measured.artefacts[ball], ball)
    seat, touched = measured.of(cone), measured.of(ball)
    for name, n, fewest in (
        (cone, len(seat), FEWEST_CONE),
        (ball, len(touched), FEWEST_SPHERE),
    ):
        if n < fewest:
            count_text = counted(n, "touch")
            raise IncompleteError(f"{name}: {count_text}, expected {fewest} or more")
    if n_copied := copied_touches((seat, touched)):
        raise IncompleteError(
            f"{n_copied} of the touches lie exactly where another does, which noise "
            "never repeats: touch anew, and move between two presses"
        )
    scatter = spread_about_mean(seat.places_mm)
    fit = fitted_sphere(sphere, touched, ball)
    off_mm = off_seat(seat.places_mm, seat.places_mm)
    if scatter.max_deviation_mm > PLAUSIBLE_MM:
        raise IncompleteError(
            f"{cone}: touch {int(off_mm.argmax()) + 1} of {len(seat)} is "
            f"{off_mm.max():.1f} mm off the others; was it the right seat? Check again"
        )
    if fit.form_mm > PLAUSIBLE_MM:
        worst = int(np.abs(fit.off_mm).argmax())
        raise IncompleteError(
            f"{ball}: form {fit.form_mm:.1f} mm, touch {worst + 1} of {len(touched)} "
            "is farthest off; was it the right sphere? Check again"
        )
    if abs(fit.size_mm) > SIZE_MM:
        raise IncompleteError(
            f"{ball}: its diameter is {fit.size_mm:+.2f} mm off the calibrated "
            f"{2.0 * float(sphere.radius_mm or 0.0):g} mm; is the radius that of this "
            "sphere, and the arm file's probe the one that touched it? Correct the one "
            "that is not, and check again"
        )
    known_c = measured.temperature_c
    return DailyCheckFigures(
        spat_2s_mm=scatter.two_s_mm,
        spat_max_mm=scatter.max_deviation_mm,
        sphere_form_mm=fit.form_mm,
        sphere_diameter_mm=fit.size_mm,
        n_cone=len(seat),
        n_sphere=len(touched),
        sphere_radius_mm=float(sphere.radius_mm or 0.0),
        temperature_c=float(known_c.mean()) if len(known_c) else None,
        stated_mm=_stated_mm(seat, touched),
    )


def _stated_mm(*artefacts: ArtefactTouches) -> float | None:
    """Return the expanded uncertainty of a touch in its worst direction."""
    variances_mm2 = []
    for touches in artefacts:
        if touches.errors is None:
            return None
        covariances_mm2 = touches.errors.covariances_mm2
        variances_mm2.append(float(np.linalg.eigvalsh(covariances_mm2)[:, -1].max()))
    return COVERAGE_FACTOR * float(np.sqrt(max(variances_mm2)))


CONE, BALL = "cone", "sphere"
CONE_TOUCHES, SPHERE_TOUCHES = 10, 9


def write_check(folder: Path, arm: Arm, radius_mm: float, start_utc: datetime) -> None:
    """Write campaign.toml and plan.toml of a check into a new folder."""
    shoulder_mm, reach_mm = reach_of(arm)
    half = CONE_TOUCHES // 2
    steps = [
        Step(
            CONE,
            side,
            n,
            f"the cone, {n} points with the elbow to the {side}, another posture each "
            "time, the same ones every day",
        )
        for side, n in (("left", half), ("right", CONE_TOUCHES - half))
    ]
    steps.append(
        Step(
            BALL,
            "",
            SPHERE_TOUCHES,
            f"the sphere, {SPHERE_TOUCHES} points: 1 on the pole, 4 at 45 degrees from "
            "it, 4 on the equator",
        )
    )
    plan = Plan(
        {CONE: {"kind": "cone"}, BALL: {"kind": "sphere", "radius_mm": radius_mm}},
        tuple(steps),
        tuple(shoulder_mm.tolist()),
        reach_mm,
    )
    folder.mkdir(parents=True)
    text = campaign_text(plan, start_utc=start_utc)
    (folder / CAMPAIGN).write_text(text, "utf-8")
    (folder / PLAN).write_text(plan_text(plan), "utf-8")
