"""Pictures of a certificate: figures against limits, errors of length, scatter."""

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from traverse.lab.report.figures import (
    BLUE,
    GREY,
    ORANGE,
    VERMILION,
    Paint,
    zero_line,
)

_COLOURS = {
    "accept": BLUE,
    "neither": ORANGE,
    "undecided": ORANGE,
    "reject": VERMILION,
    "withheld": GREY,
    None: GREY,
}
_MARKS = ("o", "s", "^", "D", "v", "P", "X")


def paintings(values: Mapping[str, Any]) -> Iterator[tuple[str, float, Paint]]:
    """List the pictures to paint: title, height in mm, and how."""
    decided = [f for f in values["figures"] if f["limit_mm"]]
    if decided:
        paint, height_mm = partial(_against_limits, decided), 25.0 + 9.0 * len(decided)
        yield "Figures as parts of their limits", height_mm, paint
    if values["lengths"]:
        yield "Errors of length", 75.0, partial(_lengths, values["lengths"])
    if values["scatters"]:
        paint, n_panels = (
            partial(_scatters, values["scatters"]),
            len(values["scatters"]),
        )
        yield "Distances of the touches", 20.0 + 28.0 * n_panels, paint


def _against_limits(figures: list[Mapping[str, Any]], figure: Figure) -> None:
    axes = figure.subplots()
    names = [entry["name"] for entry in figures]
    shares = [abs(entry["value_mm"]) / entry["limit_mm"] for entry in figures]
    rows = np.arange(len(figures))
    colours = [_COLOURS[entry["verdict"]] for entry in figures]
    axes.barh(rows, shares, color=colours, height=0.55)
    for row, entry in zip(rows, figures, strict=True):
        guard = (entry["guard_mm"] or 0.0) / entry["limit_mm"]
        axes.plot([1 - guard, 1 - guard], [row - 0.4, row + 0.4], color=GREY)
        axes.plot([1 + guard, 1 + guard], [row - 0.4, row + 0.4], color=GREY)
    axes.axvline(1.0, color="black", linewidth=0.9)
    axes.set_yticks(rows, names)
    axes.invert_yaxis()
    axes.set_xlim(0.0, max(1.25, 1.1 * max(shares)))
    axes.set_xlabel("size of the figure / limit (black), guard bands grey")


def _lengths(lengths: list[Mapping[str, Any]], figure: Figure) -> None:
    axes = figure.subplots()
    positions = list(dict.fromkeys(_position(entry) for entry in lengths))
    for number, position in enumerate(positions[:20]):
        of_position = [entry for entry in lengths if _position(entry) == position]
        axes.plot(
            [entry["length_mm"] for entry in of_position],
            [1e3 * entry["error_mm"] for entry in of_position],
            _MARKS[number % len(_MARKS)],
            markersize=3.5,
            color=BLUE if number < len(_MARKS) else VERMILION,
            alpha=0.75,
        )
    limited = sorted(
        (entry["length_mm"], entry["limit_mm"])
        for entry in lengths
        if entry["limit_mm"] is not None
    )
    if limited:
        at_mm, limit_mm = np.array(limited).T
        for side in (-1.0, 1.0):
            axes.plot(at_mm, side * 1e3 * limit_mm, color="black", linewidth=0.9)
    zero_line(axes)
    axes.set_xlabel("certified length [mm]; one mark a position, limits black")
    axes.set_ylabel("error [µm]")


def _position(entry: Mapping[str, Any]) -> str:
    """`uni-3-2` is in position `uni-3`; a bar of its own is its own position."""
    kind, _, number = str(entry["artefact"]).partition("-")
    return f"{kind}-{number.partition('-')[0]} {entry.get('tool')}"


def _scatters(scatters: list[Mapping[str, Any]], figure: Figure) -> None:
    panels = figure.subplots(len(scatters), 1, squeeze=False, sharex=True)
    for axes, entry in zip(panels[:, 0], scatters, strict=True):
        deviations = 1e3 * np.array(entry["deviations_mm"])
        numbers = np.arange(1, len(deviations) + 1)
        axes.vlines(numbers, 0.0, deviations, color=BLUE, linewidth=1.2)
        axes.plot(numbers, deviations, "o", markersize=3.0, color=BLUE)
        zero_line(axes)
        axes.set_title(entry["name"])
        axes.set_ylabel("[µm]")
    panels[-1, 0].set_xlabel("touch")
