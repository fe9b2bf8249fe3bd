"""Tests of ASME B89.4.22 beside the effective diameter: articulation, volume."""

from collections.abc import Iterator, Sequence

import numpy as np

from traverse.kinematics import fits
from traverse.lab.acceptance.budget import combined, fixture_budget
from traverse.lab.acceptance.conformity import (
    LengthError,
    Missing,
    Part,
    Scatter,
    judged_figure,
)
from traverse.lab.acceptance.limits import Limits
from traverse.lab.acceptance.procedures.lengths import largest_of, length_sets, model_of
from traverse.lab.acceptance.procedures.point_distribution import direction_remarks
from traverse.lab.acceptance.procedures.probing import refuse_another_count
from traverse.lab.measured_points.measurement import (
    IncompleteError,
    Measurement,
)
from traverse.plurals import counted

ZONES = {"near": (0.0, 0.2), "middle": (0.2, 0.8), "far": (0.8, 1.0)}
N_BARS = 20
SHORT, LONG = (0.50, 0.75), (1.20, 1.50)
_ARTICULATION = (
    "a cone's seat in three zones (near 0-20 %, middle 20-80 %, far 80-100 % of the "
    "reach), 10 points each, the elbow to both sides: delta_i = |p_i - mean|; the "
    "worst zone counts"
)
_VOLUME = (
    "a short bar (50-75 % of the arm's length) and a long one (120-150 %) in 20 "
    "positions spread over the octants: D = L_measured - L_certified, corrected for "
    "expansion"
)


def articulation(measured: Measurement, limits: Limits) -> Iterator[Part]:
    """Single-point articulation: cones `spat-near`, `spat-middle`, `spat-far`."""
    problems: list[str] = []
    largest: dict[str, float] = {}
    two_s: dict[str, float] = {}
    spans: list[tuple[str, float]] = []
    remarks: list[str] = []
    for zone, bounds in ZONES.items():
        name = f"spat-{zone}"
        touched = measured.of(name)
        try:
            if name not in measured.artefacts:
                raise IncompleteError(f"{name}: is not among the artefacts")
            refuse_another_count(touched, 10, name)
        except IncompleteError as error:
            problems.append(str(error))
            continue
        seat = fits.spread_about_mean(touched.places_mm)
        largest[zone], two_s[zone] = seat.max_deviation_mm, seat.two_s_mm
        half_mm = 0.5 * np.ptp(touched.places_mm, axis=0)
        spans += [
            (f"{zone}, (max - min)/2 {axis}", float(half))
            for axis, half in zip("xyz", half_mm, strict=True)
        ]
        share = float(measured.distance_share(seat.mean_mm[np.newaxis])[0])
        if not bounds[0] <= share <= bounds[1]:
            remarks.append(
                f"{name} is at {share:.0%} of the reach, expected {bounds[0]:.0%} to "
                f"{bounds[1]:.0%}"
            )
        if len(set(touched.features)) < 2:
            remarks.append(f"{name}: features do not tell on which side the elbow was")
        yield Scatter(name, tuple(seat.deviations_mm.tolist()))
    if problems:
        yield Missing("SPAT", tuple(problems))
        return
    budget = fixture_budget(limits.standards)
    for key, name, formula, values, parts in (
        ("spat_max", "SPAT, largest", "max delta_i", largest, spans),
        ("spat_2s", "SPAT, 2 s", "2 s, s = sqrt(sum delta_i^2/(n - 1))", two_s, []),
    ):
        yield judged_figure(
            limits,
            key,
            name,
            f"{_ARTICULATION}; {formula}",
            max(values.values()),
            budget=budget,
            parts=(*values.items(), *parts),
            remarks=remarks,
        )


def volumetric(measured: Measurement, limits: Limits) -> Iterator[Part]:
    """Volumetric test: bars `volumetric-01` to `volumetric-20`, measured once each."""
    names = [f"volumetric-{number:02d}" for number in range(1, N_BARS + 1)]
    sets, parts = length_sets(
        measured, names, "volumetric_max", limits, {1: "once"}, title="volumetric"
    )
    yield from parts
    if not sets:
        return
    counted = [error for errors in sets for error in errors]
    values = np.array([error.error_mm for error in counted])
    worst = largest_of(counted)
    rms_mm = float(np.sqrt(np.mean(values**2)))
    # d(2 rms)/dD_i; a perfect arm has no direction.
    slopes = 2.0 * values / (len(values) * rms_mm) if rms_mm > 0.0 else 0.0 * values
    yield judged_figure(
        limits,
        "volumetric_max",
        "volumetric, largest",
        f"{_VOLUME}; the D with the largest size",
        worst.error_mm,
        budget=worst.budget,
        model=model_of(counted),
        parts=(
            ("mean", float(values.mean())),
            ("twice the standard deviation", 2.0 * float(values.std(ddof=1))),
        ),
        remarks=_bar_remarks(measured, counted),
    )
    yield judged_figure(
        limits,
        "volumetric_2rms",
        "volumetric, 2 RMS",
        f"{_VOLUME}; 2 sqrt(sum D^2/20)",
        2.0 * rms_mm,
        budget=combined([error.budget for error in counted], slopes),
        model=model_of(counted, "twice rms"),
    )


def _bar_remarks(measured: Measurement, errors: Sequence[LengthError]) -> Iterator[str]:
    lengths = np.array([error.length_mm for error in errors]) / measured.reach_mm
    for text, (low, high) in (("short", SHORT), ("long", LONG)):
        if not np.any((low <= lengths) & (lengths <= high)):
            yield (
                f"no {text} bar: lengths are {lengths.min():.0%} to "
                f"{lengths.max():.0%} of the arm's reach, expected one of {low:.0%} to "
                f"{high:.0%}"
            )
    yield from direction_remarks(measured, [error.artefact for error in errors])
    places = [measured.of(error.artefact).places_mm.mean(axis=0) for error in errors]
    octants = {tuple((place > measured.shoulder_mm).tolist()) for place in places}
    if len(octants) < 4:
        count_text = counted(len(octants), "octant")
        yield f"the bars' middles lie in {count_text} about the shoulder"
