"""Pictures of a diagnosis: the ledger, each term, and where the discrepancy lives."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from traverse.arrays import Booleans, Floats
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.diagnosis.model.result import Diagnosis
from traverse.lab.diagnosis.report.discrepancies import Discrepancies, discrepancies
from traverse.lab.diagnosis.report.names import step_names
from traverse.lab.diagnosis.report.term_curve import TermCurve, term_curve, time_label
from traverse.lab.report.figures import (
    BLUE,
    GREY,
    ORANGE,
    VERMILION,
    Bins,
    Margins,
    axes_grid,
    binned,
    draw_dots,
    draw_means,
    labels_mm,
    picture,
    symmetric_limit,
    thinned,
    zero_line,
)
from traverse.lab.report.quantities import shown_unit

# Poses that say so much less than usual are no dots; means weigh all.
_NOISY = 3.0
_LONGEST_NAME = 44


def paint_ledger(figure: Figure, diagnosis: Diagnosis) -> None:
    """Draw the gap after every term."""
    names = step_names(diagnosis)
    most = _LONGEST_NAME
    short = [n if len(n) <= most else f"{n[: most - 1]}…" for n in names]
    margins = Margins(labels_mm(short), 11.0, between_columns=6.0)
    [[left, right]] = axes_grid(figure, margins, n_columns=2)
    rows = np.arange(len(names))
    rms_mm = np.array([step.held_out.rms_mm for step in diagnosis.ledger])
    factor, unit = shown_unit(float(np.max(rms_mm, initial=0.0)), "mm")
    left.barh(rows, factor * rms_mm, height=0.55, color=BLUE)
    _write_values(left, factor * rms_mm, f" {unit}", 3.0)
    left.set_xlim(0.0, 1.28 * float(np.max(factor * rms_mm, initial=1e-9)))
    left.set_xlabel(f"held-out rms [{unit}]")
    left.set_yticks(rows, short)
    for axes in (left, right):
        axes.set_ylim(len(names) - 0.5, -0.5)
    right.set_yticks(rows, [])
    chi2 = np.array([step.held_out.chi2 for step in diagnosis.ledger])
    right.plot(chi2, rows, color=BLUE, marker="o", markersize=5.0, linewidth=1.0)
    _write_values(right, chi2, "", 6.0)
    right.axvline(1.0, color=ORANGE, linewidth=1.2, linestyle="--")
    top = float(np.max(chi2, initial=1.0))
    if top > 10.0:
        right.set_xscale("log")
        # The default writes powers of ten as mathematics, which the look has none of.
        right.xaxis.set_major_formatter("{x:g}")
        right.xaxis.set_minor_formatter("")
        right.set_xlim(min(0.7, 0.8 * float(chi2.min())), 2.0 * top)
    else:
        right.set_xlim(0.0, 1.2 * max(top, 1.0))
    right.set_xlabel("held-out misfit; dashed: noise alone")


def _write_values(axes: Axes, values: Floats, unit: str, right_points: float) -> None:
    """Write the value of each row beside its end."""
    for row, value in enumerate(values):
        axes.annotate(
            f"{value:.3g}{unit}",
            (value, row),
            xytext=(right_points, 0.0),
            textcoords="offset points",
            va="center",
            fontsize=7.0,
        )


def _paint_term(figure: Figure, curve: TermCurve, shown: Booleans) -> None:
    """Draw a term: what was left over before and after, and the term itself."""
    margins = Margins(16.0, 11.0, 6.0, between_columns=14.0)
    [[left, right]] = axes_grid(figure, margins, n_columns=2)
    x = curve.covariate.values
    seen = shown & np.isfinite(x) & np.isfinite(curve.stds)
    with_term = curve.after + curve.fitted
    limits = [
        1.5
        * symmetric_limit(binned(x[seen], series[seen], curve.stds[seen]).means, 1.0)
        for series in (curve.before, with_term)
    ]
    limits[1] = max(limits[1], 1.3 * symmetric_limit(curve.fitted[seen], 1.0))
    factor, unit = shown_unit(max(limits), curve.unit)
    usual = float(np.median(curve.stds[seen])) if np.any(seen) else 1.0
    clear = seen & (curve.stds < _NOISY * usual)
    dots = thinned(np.flatnonzero(clear))
    for axes, limit in zip((left, right), limits, strict=True):
        zero_line(axes)
        axes.set_xlabel(curve.covariate.label)
        axes.set_ylim(-factor * limit, factor * limit)
    left.set_ylabel(f"{curve.what} [{unit}]")
    for values, colour, mark, label in (
        (curve.before, VERMILION, "s", "before, without any term"),
        (curve.after, BLUE, "o", "after, with all terms"),
    ):
        _scattered(left, x[dots], factor * values[dots], colour)
        means = binned(x[seen], factor * values[seen], curve.stds[seen])
        draw_means(left, means, (colour, mark, label))
    left.set_title("what is left over")
    left.legend(loc="best")
    _scattered(right, x[dots], factor * with_term[dots], GREY)
    order = np.flatnonzero(seen)[np.argsort(x[seen], kind="stable")]
    fitted, band = factor * curve.fitted[order], 2.0 * factor * curve.band[order]
    if curve.covariate.is_function:
        right.fill_between(
            x[order], fitted - band, fitted + band, color=ORANGE, alpha=0.45, lw=0.0
        )
        right.plot(x[order], fitted, color="black", linewidth=1.2, label="the term")
    else:
        right.scatter(
            x[order],
            fitted,
            s=12.0,
            marker="+",
            color="black",
            linewidths=0.6,
            label="the term",
        )
    look = (VERMILION, "s", "data, all else modelled")
    means = binned(x[seen], factor * with_term[seen], curve.stds[seen])
    draw_means(right, means, look)
    right.set_title("the term ± 2 sigma, and what the data say")
    right.legend(loc="best")


def _scattered(axes: Axes, x: Floats, y: Floats, colour: str) -> None:
    low, high = axes.get_ylim()
    inside = np.where((y > low) & (y < high), y, np.nan)
    draw_dots(axes, x, inside, (colour, "o", None), 0.25, size=0.5)


_SEED = 3
_PER_LINE = 3
_BEFORE = (VERMILION, "s", "before")
_AFTER = (BLUE, "o", "after")


def conditions(campaign: Campaign) -> Iterator[tuple[str, Floats]]:
    """Go through what surrounds the poses and varies: label and values."""
    poses = campaign.poses
    yield time_label(campaign), poses.time_s
    columns: list[tuple[str, Floats | None]] = [
        ("temperature [°C]", poses.temperature_c)
    ]
    if poses.speeds_rad_s is not None:
        speeds = np.linalg.norm(poses.speeds_rad_s, axis=1)
        columns.append(("speed, all joints [rad/s]", speeds))
    if poses.directions is not None:
        x, y, z = poses.directions.T
        columns += [
            ("direction: azimuth [degrees]", np.degrees(np.arctan2(y, x))),
            ("direction: height [degrees]", np.degrees(np.arcsin(np.clip(z, -1, 1)))),
        ]
    columns.append(("contact force [N]", poses.force_n))
    for label, values in columns:
        finite = np.empty(0) if values is None else values[np.isfinite(values)]
        if values is not None and len(finite) > 1 and np.ptp(finite) > 0.0:
            yield label, values


def _paint_artefacts(
    figure: Figure, before: Discrepancies, after: Discrepancies, shown: Booleans
) -> None:
    """Draw all misclosures by artefact, before and after."""
    campaign = before.campaign
    indices = np.unique(campaign.poses.artefacts[shown])
    names = [campaign.artefacts[index].id for index in indices]
    [[axes]] = axes_grid(figure, Margins(labels_mm(names), 11.0))
    limit_mm = symmetric_limit(before.misclosures_mm[shown], 0.998)
    factor, unit = shown_unit(limit_mm, "mm")
    limit = factor * limit_mm
    rng = np.random.default_rng(_SEED)
    for row, index in enumerate(indices):
        mine = np.flatnonzero(shown & (campaign.poses.artefacts == index))
        for compared, shift, look in ((before, -0.2, _BEFORE), (after, 0.2, _AFTER)):
            values = factor * compared.misclosures_mm[thinned(mine)].ravel()
            values = values[np.isfinite(values)]
            spread = row + shift + rng.uniform(-0.13, 0.13, len(values))
            shown_as = (*look[:2], look[2] if row == 0 else None)
            at = np.clip(values, -limit, limit)
            draw_dots(axes, at, spread, shown_as, 0.4, size=0.7)
            rms = float(np.sqrt(np.mean(values**2)))
            axes.vlines([-rms, rms], row + shift - 0.18, row + shift + 0.18, "black")
    axes.axvline(0.0, color=GREY, linewidth=0.7)
    axes.set_xlim(-1.05 * limit, 1.05 * limit)
    axes.set_ylim(len(indices) - 0.45, -0.55)
    axes.set_yticks(range(len(names)), names)
    axes.set_xlabel(f"misclosure [{unit}]; black: ± rms")
    axes.legend(loc="upper right", framealpha=0.8, frameon=True)


def _paint_joints(
    figure: Figure, before: Discrepancies, after: Discrepancies, shown: Booleans
) -> None:
    """Draw measured less simulated readings over each joint's angle."""
    names = before.campaign.joint_names
    angles_deg = np.degrees(before.campaign.poses.angles_rad)
    for joint, axes in enumerate(_grid(figure, len(names))):
        zero_line(axes)
        both = [
            binned(angles_deg[shown, joint], values[shown], stds[shown])
            for values, stds in (
                before.reading_errors_rad(joint),
                after.reading_errors_rad(joint),
            )
        ]
        largest = max(symmetric_limit(bins.means, 1.0) for bins in both)
        factor, unit = shown_unit(largest, "rad")
        for bins, look in zip(both, (_BEFORE, _AFTER), strict=True):
            draw_means(axes, bins, look, factor)
        axes.set_ylabel(f"{names[joint]} [{unit}]")
        axes.set_xlabel(f"reading of {names[joint]} [degrees]")
        if joint == 0:
            axes.legend(loc="best")


def _paint_conditions(
    figure: Figure,
    panels: tuple[tuple[str, Floats], ...],
    sizes: tuple[Floats, Floats],
    shown: Booleans,
) -> None:
    """Draw the size of the discrepancy over time, temperature, speed, direction."""
    grid = _grid(figure, len(panels))
    for number, ((label, values), axes) in enumerate(zip(panels, grid, strict=True)):
        axes.axhline(1.0, color=GREY, linewidth=0.7)
        for size, look in zip(sizes, (_BEFORE, _AFTER), strict=True):
            bins = binned(values[shown], size[shown] ** 2)
            rms = np.sqrt(bins.means)
            # d sqrt(x) = dx / (2 sqrt(x))
            errors = 0.5 * bins.errors / np.where(rms > 0.0, rms, 1.0)
            draw_means(axes, Bins(bins.centres, rms, errors), look)
        axes.set_ylim(0.0, None)
        axes.set_xlabel(label)
        if number % _PER_LINE == 0:
            axes.set_ylabel("rms [sigma]")
        if number == 0:
            axes.legend(loc="best")


def _n_lines(count: int) -> int:
    return -(-count // _PER_LINE)


def _grid(figure: Figure, count: int) -> list[Axes]:
    """Lay out so many axes, three a line."""
    margins = Margins(16.0, 11.0, between_columns=16.0, between_rows=13.0)
    n_columns = min(count, _PER_LINE)
    grid = axes_grid(figure, margins, _n_lines(count), n_columns)
    flat = [axes for line in grid for axes in line]
    for axes in flat[count:]:
        axes.set_visible(False)
    return flat[:count]


@dataclass(frozen=True, slots=True, eq=False)
class Plots:
    """Comparisons of measurement and models, and the pictures of the page.

    Attributes:
        before: Against the model without terms.
        after: Against the model of the arm that is written, in units of the same
            noise.
        files: PNG by name of the file: artefacts, joints, conditions, ledger where
            poses were kept aside, and each term over what matters for it.
    """

    before: Discrepancies
    after: Discrepancies
    files: dict[str, bytes]


def plots_of(diagnosis: Diagnosis) -> Plots:
    """Compare simulation and measurement, and paint all pictures."""
    noise = diagnosis.all_terms.network.noise
    before = discrepancies(diagnosis.before, noise)
    after = discrepancies(diagnosis.after, noise)
    everything = after
    if not diagnosis.writes_all_terms:
        everything = discrepancies(diagnosis.all_terms, noise)
    shown = ~diagnosis.excluded & ~diagnosis.blunders
    compared, campaign = (before, after, shown), diagnosis.campaign
    n_artefacts = len(np.unique(campaign.poses.artefacts[shown]))
    height_mm = 20.0 + 12.0 * n_artefacts
    files = {"artefacts.png": picture(180.0, height_mm, _paint_artefacts, *compared)}
    height_mm = 10.0 + 38.0 * _n_lines(len(campaign.joint_names))
    files["joints.png"] = picture(190.0, height_mm, _paint_joints, *compared)
    panels, sizes = tuple(conditions(campaign)), (before.sizes, after.sizes)
    height_mm = 10.0 + 40.0 * _n_lines(len(panels))
    files["conditions.png"] = picture(
        190.0, height_mm, _paint_conditions, panels, sizes, shown
    )
    if diagnosis.gap.before.n:
        height_mm = 22.0 + 9.0 * len(diagnosis.ledger)
        files["ledger.png"] = picture(180.0, height_mm, paint_ledger, diagnosis)
    for number, term in enumerate(diagnosis.terms, start=1):
        curve = term_curve(diagnosis, term, before, everything)
        if curve is not None:
            files[f"term-{number}.png"] = picture(
                180.0, 68.0, _paint_term, curve, shown
            )
    return Plots(before, after, files)
