"""Pictures of parameters: correlations; and of the joints' coverage."""

import numpy as np
from matplotlib.figure import Figure

from traverse.lab.identification.results.result import Identification
from traverse.lab.report.figures import picture

_N_SECTORS = 36


def correlation_picture(result: Identification) -> bytes:
    """Draw the correlation matrix of the free parameters."""
    n_free = len(result.parameters)
    size_mm = float(np.clip(45.0 + 3.6 * n_free, 80.0, 180.0))
    return picture(
        size_mm + 8.0,
        0.88 * size_mm,
        lambda figure: _paint_correlations(figure, result),
    )


def coverage_picture(result: Identification) -> bytes:
    """Draw how often each joint was in each sector of a turn."""
    height_mm = 22.0 + 7.0 * len(result.coverage)
    return picture(180.0, height_mm, lambda figure: _paint_coverage(figure, result))


def _paint_correlations(figure: Figure, result: Identification) -> None:
    axes = figure.subplots()
    names = [entry.name for entry in result.parameters]
    drawn = axes.imshow(
        result.correlations, cmap="RdBu_r", vmin=-1.0, vmax=1.0, interpolation="none"
    )
    size = 6.5 if len(names) <= 40 else 4.5
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=size)
    axes.set_yticks(range(len(names)), names, fontsize=size)
    axes.tick_params(length=0.0)
    owners = [name.split(".")[0] for name in names]
    for at in range(1, len(owners)):
        if owners[at] != owners[at - 1]:
            axes.axhline(at - 0.5, color="black", linewidth=0.3)
            axes.axvline(at - 0.5, color="black", linewidth=0.3)
    bar = figure.colorbar(drawn, ax=axes, shrink=0.7)
    bar.set_label("correlation")


def _paint_coverage(figure: Figure, result: Identification) -> None:
    axes = figure.subplots()
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
    axes.set_yticks(
        range(n_joints),
        [
            f"{entry.joint}: {np.degrees(entry.travel_rad):.0f}°"
            for entry in result.coverage
        ],
    )
    axes.set_xticks(np.arange(0, 361, 45))
    axes.set_yticks(np.arange(n_joints - 1) + 0.5, minor=True)
    axes.grid(which="minor", axis="y", color="white", linewidth=2.0)
    axes.tick_params(which="both", length=0.0)
    axes.set_xlabel("reading, modulo a turn [degrees]; grey: never there")
    width_deg = 360 // _N_SECTORS
    figure.colorbar(drawn, ax=axes).set_label(f"poses in {width_deg} degrees")
