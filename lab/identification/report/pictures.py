"""Pictures of residuals, parameters, coverage of the joints, and the volume."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from traverse.arrays import Floats
from traverse.lab.identification.results.result import Identification
from traverse.lab.identification.uncertainty_map import UncertaintyMap
from traverse.lab.report.figures import (
    BLUE,
    GREY,
    ORANGE,
    VERMILION,
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
from traverse.lab.statistics.distributions import equivalent_normal, normal_quantile

_SEED = 2
# With fewer poses means over parts of the range say nothing.
_LEAST_FOR_MEANS = 40
_N_SECTORS = 36
_POSE = (BLUE, "o", None)


def pictures_of(
    result: Identification, uncertainty: UncertaintyMap
) -> dict[str, bytes | None]:
    """Paint all pictures; the map is None where no parameter is free."""
    n_artefacts, n_joints = len(result.artefacts), len(result.campaign.joint_names)
    joints_mm = 12.0 + 36.0 * ((n_joints + 1) // 2)
    coverage_mm = 22.0 + 7.0 * len(result.coverage)
    pictures: dict[str, bytes | None] = {
        "artefacts": picture(
            180.0, 18.0 + 11.0 * n_artefacts, _paint_artefacts, result
        ),
        "joints": picture(180.0, joints_mm, _paint_joints, result),
        "normal": picture(100.0, 66.0, _paint_normal, result),
        "map": None,
        "coverage": picture(180.0, coverage_mm, _paint_coverage, result),
    }
    if result.parameters:
        width, height = (
            float(np.ptp(uncertainty.radii_mm)),
            float(np.ptp(uncertainty.heights_mm)),
        )
        map_mm = float(np.clip(36.0 * height / max(width, 1.0) + 24.0, 55.0, 130.0))
        pictures["map"] = picture(180.0, map_mm, _paint_map, uncertainty)
    return pictures


def _paint_artefacts(figure: Figure, result: Identification) -> None:
    """Draw all scalar misclosures, a row an artefact."""
    names = [f"{a.id} ({a.n_poses})" for a in result.artefacts]
    [[axes]] = axes_grid(figure, Margins(labels_mm(names), 11.0, 7.0))
    rng = np.random.default_rng(_SEED)
    misclosures = result.statistics.misclosures_mm
    factor, unit = shown_unit(symmetric_limit(misclosures[result.included]), "mm")
    misclosures = factor * misclosures
    limit = symmetric_limit(misclosures[result.included])
    indices = {a.id: index for index, a in enumerate(result.campaign.artefacts)}
    for row, artefact in enumerate(result.artefacts):
        mine = result.campaign.poses.artefacts == indices[artefact.id]
        good = thinned(np.flatnonzero(mine & result.included))
        flat = misclosures[good][np.isfinite(misclosures[good])]
        spread = row + rng.uniform(-0.28, 0.28, len(flat))
        draw_dots(axes, np.clip(flat, -limit, limit), spread, _POSE, 0.5)
        bad = misclosures[np.flatnonzero(mine & ~result.included)]
        _crosses(axes, bad, row, limit)
        axes.vlines(
            np.array([-1.0, 1.0]) * factor * artefact.rms_mm,
            row - 0.38,
            row + 0.38,
            color=ORANGE,
            linewidth=1.8,
        )
    axes.axvline(0.0, color=GREY, linewidth=0.7)
    axes.set_xlim(-1.05 * limit, 1.05 * limit)
    axes.set_ylim(len(result.artefacts) - 0.45, -0.55)
    axes.set_yticks(range(len(names)), names)
    axes.set_xlabel(f"misclosure [{unit}]")
    axes.set_title("dots: poses; orange: ± rms; red crosses: excluded, also off scale")


def _crosses(axes: Axes, values: Floats, row: int, limit: float) -> None:
    """Draw the worst scalar of each excluded pose (n, 3) at the edge if need be."""
    if len(values) == 0:
        return
    filled = np.nan_to_num(values)
    worst = filled[np.arange(len(filled)), np.argmax(np.abs(filled), axis=1)]
    shown_at = np.clip(worst, -limit, limit)
    axes.scatter(
        shown_at, np.full(len(shown_at), row), s=22.0, marker="x", color=VERMILION
    )


def _paint_joints(figure: Figure, result: Identification) -> None:
    """Draw the corrections of each joint's readings against the readings."""
    names = result.campaign.joint_names
    margins = Margins(15.0, 11.0, between_columns=16.0, between_rows=12.0)
    grid = axes_grid(figure, margins, (len(names) + 1) // 2, 2)
    everyone = np.flatnonzero(result.included)
    shown = thinned(everyone)
    angles_deg = np.degrees(result.campaign.poses.angles_rad)
    corrections = result.statistics.corrections_rad
    for k, name in enumerate(names):
        axes = grid[k // 2][k % 2]
        zero_line(axes)
        limit_rad = symmetric_limit(corrections[everyone, k], 0.995)
        factor, unit = shown_unit(limit_rad, "rad")
        values = factor * corrections[:, k]
        draw_dots(axes, angles_deg[shown, k], values[shown], _POSE, 0.4)
        if np.count_nonzero(np.isfinite(values[everyone])) >= _LEAST_FOR_MEANS:
            bins = binned(angles_deg[everyone, k], values[everyone])
            draw_means(axes, bins, (VERMILION, "o", None))
        axes.set_ylim(-factor * limit_rad, factor * limit_rad)
        axes.set_ylabel(f"{name} [{unit}]")
        axes.set_xlabel(f"reading of {name} [degrees]")
    if len(names) % 2:
        grid[-1][1].set_visible(False)


def _paint_normal(figure: Figure, result: Identification) -> None:
    [[axes]] = axes_grid(figure, Margins(13.0, 11.0))
    w = _scaled_w(result)
    if len(w) == 0:
        return
    shown = thinned(np.arange(len(w)))
    expected = np.array(
        [normal_quantile(0.5 + 0.5 * (rank + 0.5) / len(w)) for rank in shown]
    )
    end = 1.05 * float(expected[-1])
    axes.plot([0.0, end], [0.0, end], color="black", linewidth=1.0)
    axes.scatter(expected, w[shown], s=6.0, color=BLUE, linewidths=0.0)
    axes.set_xlabel("|w| / sigma0 that a normal leads to expect")
    axes.set_ylabel("|w| / sigma0 of a pose")
    axes.set_xlim(0.0, end)
    axes.set_ylim(0.0, None)


def _scaled_w(result: Identification) -> Floats:
    """Compute |w| of the poses that took part if sigma0 were 1, sorted."""
    statistics, included = result.statistics, result.included
    scale = max(result.sigma0, 1e-300)
    w = equivalent_normal(
        statistics.statistics[included] / scale**2, statistics.degrees[included]
    )
    return np.sort(w[np.isfinite(w)])


def _paint_coverage(figure: Figure, result: Identification) -> None:
    """Draw how often each joint was in each sector of a turn."""
    names = [
        f"{entry.joint}: {np.degrees(entry.travel_rad):.0f}°"
        for entry in result.coverage
    ]
    [[axes]] = axes_grid(figure, Margins(labels_mm(names), 11.0, right=9.0))
    counts = np.array([entry.sectors for entry in result.coverage], dtype=np.float64)
    n_joints = len(counts)
    filled = np.where(counts > 0.0, counts, np.nan)
    axes.set_facecolor("#eeeeee")
    drawn = axes.imshow(
        filled,
        cmap="cividis_r",
        vmin=0.0,
        aspect="auto",
        interpolation="none",
        extent=(0.0, 360.0, n_joints - 0.5, -0.5),
    )
    axes.set_yticks(range(n_joints), names)
    axes.set_xticks(np.arange(0, 361, 45))
    axes.set_yticks(np.arange(n_joints - 1) + 0.5, minor=True)
    axes.grid(which="minor", axis="y", color="white", linewidth=2.0)
    axes.tick_params(which="both", length=0.0)
    axes.set_xlabel("reading, modulo a turn [degrees]; grey: never there")
    width_deg = 360 // _N_SECTORS
    figure.colorbar(drawn, ax=axes).set_label(f"poses in {width_deg} degrees")


def _paint_map(figure: Figure, uncertainty: UncertaintyMap) -> None:
    """Draw a half plane through the first axis for each direction."""
    margins = Margins(16.0, 11.0, 10.0, right=12.0, between_columns=3.0)
    [panels] = axes_grid(figure, margins, n_columns=4)
    some_mm = uncertainty.deviations_mm[np.isfinite(uncertainty.deviations_mm)]
    factor, unit = shown_unit(float(some_mm.max(initial=0.0)), "mm")
    some = factor * some_mm
    highest = float(some.max()) if len(some) else 1.0
    lowest = float(some.min()) if len(some) else 0.0
    titles = [
        f"{uncertainty.length_mm:.0f} mm\nradially",
        f"{uncertainty.length_mm:.0f} mm\nacross",
        f"{uncertainty.length_mm:.0f} mm\nalong the axis",
        "from the\nreference (+)",
    ]
    radius_edges, height_edges = (
        _edges(uncertainty.radii_mm),
        _edges(uncertainty.heights_mm),
    )
    for axes, title, values in zip(
        panels, titles, factor * uncertainty.deviations_mm, strict=True
    ):
        axes.set_facecolor("#eeeeee")
        drawn = axes.pcolormesh(
            radius_edges,
            height_edges,
            np.ma.masked_invalid(values),
            cmap="cividis",
            vmin=lowest,
            vmax=highest,
        )
        axes.set_aspect("equal")
        axes.set_title(title)
        axes.set_xlabel("radius [mm]")
        axes.set_xlim(0.0, radius_edges[-1])
        axes.set_ylim(height_edges[0], height_edges[-1])
    radius_mm, height_mm = uncertainty.reference_place_mm
    panels[3].plot(radius_mm, height_mm, "+", color="white", markersize=9.0)
    for axes in panels[1:]:
        axes.tick_params(labelleft=False)
    panels[0].set_ylabel("height along the first axis [mm]")
    bar = figure.colorbar(drawn, ax=panels, shrink=0.9, pad=0.02)
    bar.set_label(f"standard deviation of the distance [{unit}]")


def _edges(middles: Floats) -> Floats:
    half = 0.5 * (middles[1] - middles[0])
    return np.append(middles - half, middles[-1] + half)
