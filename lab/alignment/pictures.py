"""Pictures of an alignment: residuals as arrows, error ellipsoids in the volume."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from traverse.lab.report.figures import BLUE, GREY, ORANGE, VERMILION, Paint

_VIEWS = ((0, 1), (0, 2), (1, 2))
_AXES = "xyz"
_ARROW = 0.15  # of the picture's extent
_N_AROUND = 60


def alignment_paintings(
    values: Mapping[str, Any],
) -> Iterator[tuple[str, float, Paint]]:
    """List the pictures to paint: title, height in mm, and how."""
    if any(point["nominal_mm"] is not None for point in values["points"]):
        yield "Residuals", 65.0, lambda figure: _residuals(values, figure)
    if values["quality"]["places"]:
        yield "Errors in the volume", 65.0, lambda figure: ellipsoids(values, figure)


def _views(values: Mapping[str, Any], figure: Figure) -> Iterator[tuple[Axes, Any]]:
    panels = figure.subplots(1, 3)
    volume = values["quality"]["volume"]
    for axes, view in zip(panels, _VIEWS, strict=True):
        _outline(axes, volume, view)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel(f"{_AXES[view[0]]} [mm]")
        axes.set_ylabel(f"{_AXES[view[1]]} [mm]")
        yield axes, list(view)


def _outline(axes: Axes, volume: Mapping[str, Any], view: tuple[int, int]) -> None:
    if volume["kind"] == "box":
        low, high = (np.array(volume[k])[list(view)] for k in ("min_mm", "max_mm"))
        x = [low[0], high[0], high[0], low[0], low[0]]
        y = [low[1], low[1], high[1], high[1], low[1]]
    else:
        turn = np.linspace(0.0, 2.0 * np.pi, _N_AROUND)
        centre = np.array(volume["centre_mm"])[list(view)]
        x = (centre[0] + volume["radius_mm"] * np.cos(turn)).tolist()
        y = (centre[1] + volume["radius_mm"] * np.sin(turn)).tolist()
    axes.plot(x, y, color=GREY, linewidth=0.8, linestyle="--")


def _extent_mm(values: Mapping[str, Any]) -> float:
    volume = values["quality"]["volume"]
    if volume["kind"] == "ball":
        return 2.0 * float(volume["radius_mm"])
    sides = np.array(volume["max_mm"]) - np.array(volume["min_mm"])
    return float(np.max(sides))


def _residuals(values: Mapping[str, Any], figure: Figure) -> None:
    points = [point for point in values["points"] if point["nominal_mm"] is not None]
    places = np.array([point["nominal_mm"] for point in points])
    residuals = np.array([point["residual_mm"] for point in points])
    largest = float(np.max(np.linalg.norm(residuals, axis=1), initial=1e-9))
    factor = _ARROW * _extent_mm(values) / largest
    for axes, view in _views(values, figure):
        axes.plot(*places[:, view].T, "o", color=BLUE, markersize=3.5)
        axes.quiver(
            *places[:, view].T,
            *(factor * residuals[:, view].T),
            angles="xy",
            scale_units="xy",
            scale=1.0,
            color=VERMILION,
            width=0.008,
        )
        if len(points) <= 20:
            for point, place in zip(points, places[:, view], strict=True):
                axes.annotate(
                    point["name"],
                    place,
                    xytext=(3, 3),
                    textcoords="offset points",
                    fontsize=6.5,
                )
    figure.suptitle(
        f"nominal less measured, {factor:.0f} times as long; the longest is "
        f"{1e3 * largest:.1f} µm",
        fontsize=8.0,
    )


def ellipsoids(
    values: Mapping[str, Any], figure: Figure, factor: float | None = None
) -> None:
    """Paint error ellipsoids, so many times as large; None chooses."""
    places = values["quality"]["places"]
    centres = np.array([place["place_mm"] for place in places])
    errors = np.array([place["covariance_mm2"] for place in places])
    largest = float(np.sqrt(max(np.linalg.eigvalsh(errors)[:, -1].max(), 1e-24)))
    factor = factor or _ARROW * _extent_mm(values) / largest
    turn = np.linspace(0.0, 2.0 * np.pi, _N_AROUND)
    circle = np.stack([np.cos(turn), np.sin(turn)])
    for axes, view in _views(values, figure):
        for centre, error in zip(centres, errors, strict=True):
            sizes, vectors = np.linalg.eigh(error[np.ix_(view, view)])
            rim = vectors * np.sqrt(np.maximum(sizes, 0.0)) @ circle
            x, y = centre[view][:, np.newaxis] + factor * rim
            axes.fill(x, y, color=ORANGE, alpha=0.45)
            axes.plot(x, y, color=VERMILION, linewidth=0.6)
        known = [p["nominal_mm"] for p in values["points"] if p["nominal_mm"]]
        if known:
            axes.plot(*np.array(known)[:, view].T, "o", color=BLUE, markersize=3.0)
    figure.suptitle(
        f"error ellipsoids of one standard deviation, {factor:.0f} times as large; the "
        f"longest axis is {1e3 * largest:.1f} µm; points blue",
        fontsize=8.0,
    )
