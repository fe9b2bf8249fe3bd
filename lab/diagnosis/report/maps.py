"""Pictures of where the discrepancy lives: artefacts, joints, conditions."""

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from traverse.arrays import Booleans, Floats
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.diagnosis.report.covariates import time_label
from traverse.lab.diagnosis.report.discrepancies import Discrepancies
from traverse.lab.report.figures import (
    BLUE,
    GREY,
    VERMILION,
    Bins,
    binned,
    dot_size,
    draw_means,
    picture,
    symmetric_limit,
    thinned,
    zero_line,
)
from traverse.lab.report.quantities import shown_unit

_SEED = 3
_PER_LINE = 3
_BEFORE = (VERMILION, "s", "before")
_AFTER = (BLUE, "o", "after")


def artefact_map(before: Discrepancies, after: Discrepancies, shown: Booleans) -> bytes:
    """Draw all misclosures by artefact, before and after."""
    n_rows = len(np.unique(before.campaign.poses.artefacts[shown]))
    height_mm = 20.0 + 12.0 * n_rows
    return picture(180.0, height_mm, _paint_artefacts, before, after, shown)


def joint_map(before: Discrepancies, after: Discrepancies, shown: Booleans) -> bytes:
    """Draw measured less simulated readings over each joint's angle."""
    n_lines = -(-len(before.campaign.joint_names) // _PER_LINE)
    height_mm = 10.0 + 38.0 * n_lines
    return picture(190.0, height_mm, _paint_joints, before, after, shown)


def condition_map(
    before: Discrepancies, after: Discrepancies, shown: Booleans
) -> bytes:
    """Draw the size of the discrepancy over time, temperature, speed, direction."""
    panels = tuple(conditions(before.campaign))
    n_lines = -(-len(panels) // _PER_LINE)
    sizes = before.sizes, after.sizes
    height_mm = 10.0 + 40.0 * n_lines
    return picture(190.0, height_mm, _paint_conditions, panels, sizes, shown)


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
    axes = figure.subplots()
    campaign = before.campaign
    indices = np.unique(campaign.poses.artefacts[shown])
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
            axes.scatter(
                np.clip(values, -limit, limit),
                spread,
                s=0.7 * dot_size(len(values)),
                color=look[0],
                marker=look[1],
                alpha=0.4,
                linewidths=0.0,
                label=look[2] if row == 0 else None,
            )
            rms = float(np.sqrt(np.mean(values**2)))
            axes.vlines([-rms, rms], row + shift - 0.18, row + shift + 0.18, "black")
    axes.axvline(0.0, color=GREY, linewidth=0.7)
    axes.set_xlim(-1.05 * limit, 1.05 * limit)
    axes.set_ylim(len(indices) - 0.45, -0.55)
    axes.set_yticks(range(len(indices)), [campaign.artefacts[i].id for i in indices])
    axes.set_xlabel(f"misclosure [{unit}]; black: ± rms")
    axes.legend(loc="upper right", framealpha=0.8, frameon=True)


def _paint_joints(
    figure: Figure, before: Discrepancies, after: Discrepancies, shown: Booleans
) -> None:
    names = before.campaign.joint_names
    angles_deg = np.degrees(before.campaign.poses.angles_rad)
    for joint, axes in enumerate(_grid(figure, len(names))):
        zero_line(axes)
        found = [
            binned(angles_deg[shown, joint], values[shown], stds[shown])
            for values, stds in (
                before.reading_errors_rad(joint),
                after.reading_errors_rad(joint),
            )
        ]
        largest = max(symmetric_limit(bins.means, 1.0) for bins in found)
        factor, unit = shown_unit(largest, "rad")
        for bins, look in zip(found, (_BEFORE, _AFTER), strict=True):
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


def _grid(figure: Figure, count: int) -> list[Axes]:
    """Lay out so many axes, three a line."""
    n_lines = -(-count // _PER_LINE)
    grid = figure.subplots(n_lines, min(count, _PER_LINE), squeeze=False)
    flat: list[Axes] = list(grid.ravel())
    for axes in flat[count:]:
        axes.set_visible(False)
    return flat[:count]
