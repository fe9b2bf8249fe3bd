"""Tests on a calibrated sphere: size, form, location by articulation.

The measured points are ball centres: they lie on a sphere of the test sphere's
radius plus that of the tip, at the temperature of the measurement.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from traverse.kinematics.fits import enclosing_sphere
from traverse.lab.acceptance.budget import (
    SMOOTH_FORM,
    Budget,
    CertifiedValue,
    form_budget,
    form_factor,
    length_budget,
    repeatability,
)
from traverse.lab.acceptance.conformity import Missing, Part, Scatter, judged_figure
from traverse.lab.acceptance.limits import Limits
from traverse.lab.acceptance.monte_carlo import Model
from traverse.lab.acceptance.procedures.lengths import LEAST_OF_SCAN, refuse_few
from traverse.lab.acceptance.procedures.point_distribution import half_sphere_remarks
from traverse.lab.artefacts.sphere import Sphere
from traverse.lab.measured_points.measurement import (
    SCANNED,
    ArtefactTouches,
    FittedSphere,
    IncompleteError,
    Measurement,
    certified_sphere,
    fitted,
    fitted_sphere,
    growth,
    identity_of,
    warmer_c,
)
from traverse.plurals import counted

SIZE = (
    "25 points on a calibrated sphere, least-squares sphere (c, r) of them: "
    "P_SIZE = 2 r - D_cal, with sign. Two locations, the one with the larger size "
    "counts. Pattern of the points (1 on the pole, 4 at 22.5, 8 at 45, 4 at 67.5, 8 at "
    "90 degrees from it): general knowledge"
)
FORM = (
    "of the same points: P_FORM = max|p - c| - min|p - c|. Two locations, the worse "
    "counts"
)
LOCATIONS = {
    "l_dia": (
        "L_DIA (5x5)",
        "5 groups of 5 points on one sphere, the probe pointing another way in each "
        "group; a least-squares sphere each; L_DIA is the diameter of the smallest "
        "sphere that encloses the five centres",
    ),
    "scan_l_dia": (
        "L_Dia.5x5",
        "5 scans of one sphere, the probe pointing another way in each; a "
        "least-squares sphere of each; L_Dia is the diameter of the smallest sphere "
        "that encloses the five centres",
    ),
}
# Of test spheres of ISO 10360-12 (published), and of ISO 10360-8 (general knowledge).
DIAMETERS_MM = (10.0, 51.0)
DIAMETER = (
    "9 points on a calibrated sphere (4 on the equator, 4 at 45 degrees, 1 on the "
    "pole), least-squares sphere, three times: max|D - D_cal|"
)


def refuse_another_count(touched: ArtefactTouches, n_expected: int, place: str) -> None:
    """Refuse another number of touches.

    Raises:
        IncompleteError: There are fewer or more.
    """
    if len(touched) < n_expected:
        missing = n_expected - len(touched)
        raise IncompleteError(
            f"{place}: {counted(missing, 'point', 'are')} missing of {n_expected}"
        )
    if len(touched) > n_expected:
        raise IncompleteError(
            f"{place}: {counted(len(touched), 'point')}, expected {n_expected}; take "
            f"{len(touched) - n_expected} out"
        )


def diameter_budget(
    sphere: Sphere,
    touched: ArtefactTouches,
    fit: FittedSphere,
    limits: Limits,
    smooth_form: float = SMOOTH_FORM,
) -> Budget:
    """Draw up the budget of a diameter, of the arm's scatter about the sphere too."""
    normals = touched.places_mm - fit.centre_mm
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    design = np.column_stack([normals, np.ones(len(normals))])
    factor = 2.0 * float(np.sqrt(np.linalg.pinv(design.T @ design)[3, 3]))
    value = CertifiedValue(
        identity_of(sphere),
        2.0 * float(sphere.radius_mm or 0.0),
        2.0 * (sphere.radius_std_mm or 0.0),
        sphere.stated_expansion,
        warmer_c(sphere, touched),
        form_factor(factor, smooth_form),
    )
    degrees = len(touched) - 4
    scatter_mm = float(np.sqrt(np.sum(fit.off_mm**2) / degrees))
    line = repeatability(
        "scatter of the touches",
        f"{scatter_mm:.5f} mm x {factor:.3g}",
        factor * scatter_mm,
        degrees,
    )
    return length_budget(value, limits.standards).with_lines(line)


def size_and_form(
    measured: Measurement, names: Sequence[str], limits: Limits
) -> Iterator[Part]:
    """P_SIZE and P_FORM of ISO 10360-12 at some locations."""
    sizes_mm: dict[str, float] = {}
    budgets: dict[str, Budget] = {}
    forms_mm: dict[str, float] = {}
    problems: list[str] = []
    remarks: list[str] = []
    for name in names:
        touched = measured.of(name)
        try:
            sphere = certified_sphere(measured.artefacts.get(name), name)
            refuse_another_count(touched, 25, name)
            fit = fitted_sphere(sphere, touched, name)
        except IncompleteError as error:
            problems.append(str(error))
            continue
        sizes_mm[name], forms_mm[name] = fit.size_mm, fit.form_mm
        budgets[name] = diameter_budget(sphere, touched, fit, limits)
        remarks += diameter_remarks(sphere, name)
        remarks += half_sphere_remarks(touched, fit.centre_mm, name)
        yield Scatter(name, tuple(fit.off_mm.tolist()))
    if problems:
        yield Missing("P_SIZE", tuple(problems))
        yield Missing("P_FORM", tuple(problems))
        return
    worst = max(sizes_mm, key=lambda name: abs(sizes_mm[name]))
    yield judged_figure(
        limits,
        "p_size",
        "P_SIZE",
        SIZE,
        sizes_mm[worst],
        budget=budgets[worst],
        model=Model(np.array(list(sizes_mm.values())), tuple(budgets.values())),
        source="published",
        parts=sizes_mm.items(),
        remarks=(*remarks, *_location_remarks(measured, names)),
    )
    yield judged_figure(
        limits,
        "p_form",
        "P_FORM",
        FORM,
        max(forms_mm.values()),
        budget=form_budget(limits.standards),
        source="published",
        parts=forms_mm.items(),
    )


def diameter_remarks(sphere: Sphere, name: str) -> Iterator[str]:
    """Return where a test sphere is smaller or larger than the standards allow."""
    least_mm, most_mm = DIAMETERS_MM
    diameter_mm = 2.0 * float(sphere.radius_mm or 0.0)
    if not least_mm <= diameter_mm <= most_mm:
        yield (
            f"{name}: the diameter is {diameter_mm:g} mm, expected {least_mm:g} to "
            f"{most_mm:g} mm"
        )


def _location_remarks(measured: Measurement, names: Sequence[str]) -> Iterator[str]:
    """Return where the two locations are one and the same."""
    centres = [measured.of(name).places_mm.mean(axis=0) for name in names]
    if np.linalg.norm(centres[0] - centres[1]) < 0.1 * measured.reach_mm:
        yield (
            f"{' and '.join(names)} are less than a tenth of the reach apart: two "
            "locations are wanted"
        )


def _parts_of(touched: ArtefactTouches, name: str, n: int, plural: str) -> list[str]:
    """List the features that distinguish the parts of a test.

    Raises:
        IncompleteError: There are more or fewer of them.
    """
    features = list(dict.fromkeys(touched.features))
    if len(features) != n:
        raise IncompleteError(
            f"{name}: has {len(features)} {plural} ({', '.join(features) or 'none'}), "
            f"expected {n}, told apart by their feature"
        )
    return features


def location(
    measured: Measurement, name: str, limits: Limits, key: str = "l_dia"
) -> Iterator[Part]:
    """L_DIA of ISO 10360-12, or of a scan; features name the five groups."""
    title, definition = LOCATIONS[key]
    touched = measured.of(name)
    try:
        sphere = certified_sphere(measured.artefacts.get(name), name)
        groups = _parts_of(touched, name, 5, "groups")
        centres_mm = []
        for group in groups:
            part = touched.of(group)
            if name.startswith(SCANNED):
                refuse_few(part, f"{name} group {group}", LEAST_OF_SCAN)
            else:
                refuse_another_count(part, 5, f"{name} group {group}")
            radius_mm = None
            if limits.l_dia_radius == "calibrated":
                radius_mm = float(sphere.radius_mm or 0.0) * growth(sphere, part)
                radius_mm += float(part.tip_mm.mean())
            centres_mm.append(
                fitted(part, f"{name} group {group}", radius_mm).centre_mm
            )
    except IncompleteError as error:
        yield Missing(title, (str(error),))
        return
    around = enclosing_sphere(np.array(centres_mm))
    away_mm = np.linalg.norm(np.array(centres_mm) - around.centre_mm, axis=1)
    held = ", ".join(groups[index] for index in around.supports)
    yield judged_figure(
        limits,
        key,
        title,
        f"{definition}. Radius of the five spheres: {limits.l_dia_radius}. Groups "
        f"that hold the sphere: {held}",
        2.0 * around.radius_mm,
        budget=form_budget(limits.standards),
        parts=(
            (f"{group} from the middle", float(away))
            for group, away in zip(groups, away_mm, strict=True)
        ),
    )


def effective_diameter(
    measured: Measurement, name: str, limits: Limits
) -> Iterator[Part]:
    """Effective diameter of ASME B89.4.22; features name the three repeats."""
    touched = measured.of(name)
    try:
        sphere = certified_sphere(measured.artefacts.get(name), name)
        repeats = _parts_of(touched, name, 3, "repeats")
        errors_mm: dict[str, float] = {}
        budgets: dict[str, Budget] = {}
        for repeat in repeats:
            part = touched.of(repeat)
            refuse_another_count(part, 9, f"{name} repeat {repeat}")
            fit = fitted_sphere(sphere, part, f"{name} repeat {repeat}")
            errors_mm[repeat] = fit.size_mm
            budgets[repeat] = diameter_budget(sphere, part, fit, limits)
    except IncompleteError as error:
        yield Missing("effective diameter", (str(error),))
        return
    worst = max(errors_mm, key=lambda repeat: abs(errors_mm[repeat]))
    yield judged_figure(
        limits,
        "effective_diameter",
        "effective diameter",
        DIAMETER,
        abs(errors_mm[worst]),
        budget=budgets[worst],
        model=Model(np.array(list(errors_mm.values())), tuple(budgets.values())),
        parts=((f"repeat {name}", error) for name, error in errors_mm.items()),
    )
