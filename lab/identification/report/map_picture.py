"""The picture of the volumetric uncertainty."""

import numpy as np
from matplotlib.figure import Figure

from traverse.arrays import Floats
from traverse.lab.identification.volume.uncertainty_map import UncertaintyMap
from traverse.lab.report.figures import picture
from traverse.lab.report.quantities import shown_unit


def map_picture(found: UncertaintyMap) -> bytes:
    """Draw a half plane through the first axis for each direction."""
    width = float(np.ptp(found.radii_mm))
    height = float(np.ptp(found.heights_mm))
    height_mm = float(np.clip(36.0 * height / max(width, 1.0) + 24.0, 55.0, 130.0))
    return picture(180.0, height_mm, lambda figure: _paint(figure, found))


def _paint(figure: Figure, found: UncertaintyMap) -> None:
    panels = figure.subplots(1, 4, sharex=True, sharey=True)
    some_mm = found.deviations_mm[np.isfinite(found.deviations_mm)]
    factor, unit = shown_unit(float(some_mm.max(initial=0.0)), "mm")
    some = factor * some_mm
    highest = float(some.max()) if len(some) else 1.0
    lowest = float(some.min()) if len(some) else 0.0
    titles = [
        f"{found.length_mm:.0f} mm\nradially",
        f"{found.length_mm:.0f} mm\nacross",
        f"{found.length_mm:.0f} mm\nalong the axis",
        "from the\nreference (+)",
    ]
    radius_edges, height_edges = _edges(found.radii_mm), _edges(found.heights_mm)
    for axes, title, values in zip(
        panels, titles, factor * found.deviations_mm, strict=True
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
    radius_mm, height_mm = found.reference_place_mm
    panels[3].plot(radius_mm, height_mm, "+", color="white", markersize=9.0)
    panels[0].set_ylabel("height along the first axis [mm]")
    bar = figure.colorbar(drawn, ax=list(panels), shrink=0.9, pad=0.02)
    bar.set_label(f"standard deviation of the distance [{unit}]")


def _edges(middles: Floats) -> Floats:
    half = 0.5 * (middles[1] - middles[0])
    return np.append(middles - half, middles[-1] + half)
