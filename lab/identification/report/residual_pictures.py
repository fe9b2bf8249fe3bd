"""Pictures of residuals: by artefact, by joint, and against the normal."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from traverse.arrays import Floats
from traverse.lab.identification.results.result import Identification
from traverse.lab.report.figures import (
    BLUE,
    GREY,
    ORANGE,
    VERMILION,
    binned,
    dot_size,
    draw_means,
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
_SHOWN_W = 4.0


def by_artefact(result: Identification) -> bytes:
    """Draw all scalar misclosures, a row an artefact."""
    n_rows = len(result.artefacts)
    return picture(
        180.0, 18.0 + 11.0 * n_rows, lambda figure: _paint_artefacts(figure, result)
    )


def by_joint(result: Identification) -> bytes:
    """Draw the corrections of each joint's readings against the readings."""
    n_rows = (len(result.campaign.joint_names) + 1) // 2
    return picture(
        180.0, 12.0 + 36.0 * n_rows, lambda figure: _paint_joints(figure, result)
    )


def against_normal(result: Identification) -> bytes:
    """Draw histogram and quantiles of |w| beside those of a normal."""
    return picture(180.0, 66.0, lambda figure: _paint_normal(figure, result))


def _paint_artefacts(figure: Figure, result: Identification) -> None:
    axes = figure.subplots()
    rng = np.random.default_rng(_SEED)
    misclosures = result.statistics.misclosures_mm
    factor, unit = shown_unit(symmetric_limit(misclosures[result.included]), "mm")
    misclosures = factor * misclosures
    limit = symmetric_limit(misclosures[result.included])
    indices = {a.id: index for index, a in enumerate(result.campaign.artefacts)}
    for row, artefact in enumerate(result.artefacts):
        mine = result.campaign.poses.artefacts == indices[artefact.id]
        good = thinned(np.flatnonzero(mine & result.included))
        _dots(axes, misclosures[good], row, rng, limit)
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
    axes.set_yticks(
        range(len(result.artefacts)),
        [f"{a.id} ({a.n_poses})" for a in result.artefacts],
    )
    axes.set_xlabel(f"misclosure [{unit}]")
    axes.set_title("dots: poses; orange: ± rms; red crosses: excluded, also off scale")


def _dots(
    axes: Axes, values: Floats, row: int, rng: np.random.Generator, limit: float
) -> None:
    """Draw scalars (n, 3) with NaN in a row, spread across it."""
    flat = values[np.isfinite(values)]
    spread = row + rng.uniform(-0.28, 0.28, len(flat))
    axes.scatter(
        np.clip(flat, -limit, limit),
        spread,
        s=dot_size(len(flat)),
        color=BLUE,
        alpha=0.5,
        linewidths=0.0,
    )


def _crosses(axes: Axes, values: Floats, row: int, limit: float) -> None:
    """Draw the worst scalar of each excluded pose (n, 3) at the edge if need be."""
    if len(values) == 0:
        return
    filled = np.nan_to_num(values)
    worst = filled[np.arange(len(filled)), np.argmax(np.abs(filled), axis=1)]
    at = np.clip(worst, -limit, limit)
    axes.scatter(at, np.full(len(at), row), s=22.0, marker="x", color=VERMILION)


def _paint_joints(figure: Figure, result: Identification) -> None:
    names = result.campaign.joint_names
    grid = figure.subplots((len(names) + 1) // 2, 2, squeeze=False)
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
        axes.scatter(
            angles_deg[shown, k],
            values[shown],
            s=dot_size(len(shown)),
            color=BLUE,
            alpha=0.4,
            linewidths=0.0,
        )
        if np.count_nonzero(np.isfinite(values[everyone])) >= _LEAST_FOR_MEANS:
            bins = binned(angles_deg[everyone, k], values[everyone])
            draw_means(axes, bins, (VERMILION, "o", None))
        axes.set_ylim(-factor * limit_rad, factor * limit_rad)
        axes.set_ylabel(f"{name} [{unit}]")
        axes.set_xlabel(f"reading of {name} [degrees]")
    if len(names) % 2:
        grid[-1][1].set_visible(False)


def _paint_normal(figure: Figure, result: Identification) -> None:
    left, right = figure.subplots(1, 2)
    w = _scaled_w(result)
    if len(w) == 0:
        return
    top = max(_SHOWN_W, 1.05 * float(w[-1]))
    n_bins = int(np.clip(1.5 * np.sqrt(len(w)), 8, 60))
    edges = np.linspace(0.0, top, n_bins + 1)
    left.hist(w, bins=edges.tolist(), color=BLUE, alpha=0.55, label="poses")
    x = np.linspace(0.0, top, 300)
    area = len(w) * (edges[1] - edges[0])
    density = np.sqrt(2.0 / np.pi) * np.exp(-0.5 * x**2)
    left.plot(x, area * density, color="black", linewidth=1.0, label="normal")
    left.set_xlabel("|w| / sigma0 of a pose")
    left.set_ylabel("poses")
    left.set_xlim(0.0, top)
    left.legend()
    shown = thinned(np.arange(len(w)))
    expected = np.array(
        [normal_quantile(0.5 + 0.5 * (at + 0.5) / len(w)) for at in shown]
    )
    end = 1.05 * float(expected[-1])
    right.plot([0.0, end], [0.0, end], color="black", linewidth=1.0)
    right.scatter(expected, w[shown], s=6.0, color=BLUE, linewidths=0.0)
    right.set_xlabel("|w| / sigma0 that a normal leads to expect")
    right.set_ylabel("|w| / sigma0 of a pose")
    right.set_xlim(0.0, end)
    right.set_ylim(0.0, None)


def _scaled_w(result: Identification) -> Floats:
    """Compute |w| of the poses that took part if sigma0 were 1, sorted."""
    found, taken = result.statistics, result.included
    scale = max(result.sigma0, 1e-300)
    w = equivalent_normal(found.statistics[taken] / scale**2, found.degrees[taken])
    return np.sort(w[np.isfinite(w)])
