"""The worked example: small residuals on nearly a line, larger ones on a wide net."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.alignment.point_distributions import Outcome, drawn_rotation
from traverse.arrays import Floats
from traverse.kinematics.helmert.transformation import Helmert
from traverse.kinematics.helmert.volume import Box
from traverse.lab.alignment.best_fit import best_fit_alignment
from traverse.lab.alignment.files import alignment_values
from traverse.lab.alignment.nominal import fixed_volume
from traverse.lab.alignment.pictures import ellipsoids
from traverse.lab.alignment.touches import CommonPoints, Place
from traverse.lab.report.figures import (
    BLUE,
    GREY,
    VERMILION,
    picture,
)

VOLUME = Box(np.zeros(3), np.array([1000.0, 600.0, 400.0]))
NEARLY_A_LINE = np.array(
    [[0.0, 300, 200], [350, 330, 180], [700, 280, 220], [1000, 310, 190]]
)
WIDE = np.array([[0.0, 0, 0], [1000, 0, 350], [0, 600, 400], [1000, 600, 50]])
_STEPS = 20
_N_DRAWS = 500


@dataclass(frozen=True, slots=True, eq=False)
class Example:
    """One of both nets.

    Attributes:
        residual_mm: root mean square length of the residuals.
        true_mm: root mean square error in the volume over many measurements.
    """

    title: str
    values: dict[str, Any]
    residual_mm: float
    true_mm: float


def examples() -> tuple[Example, Example]:
    """Make both, with the residuals of the paper."""
    return (
        _example("four points nearly on a line", NEARLY_A_LINE, 0.025),
        _example("four points in the corners", WIDE, 0.040),
    )


def _example(title: str, to_mm: Floats, residual_mm: float) -> Example:
    """Scale drawn errors to the requested size of residuals."""
    rng = np.random.default_rng(3)
    true = Helmert(drawn_rotation(rng), rng.uniform(-500.0, 500.0, 3))
    errors = rng.normal(size=to_mm.shape)
    size_mm = residual_mm
    for _ in range(_STEPS):
        values = _aligned(title, to_mm, true, size_mm * errors)
        size_mm *= residual_mm / _residual_mm(values)
    # What such errors do in the mean of many measurements, not just of this one:
    squares = []
    places_mm = VOLUME.mean_mm + (VOLUME.corners_mm - VOLUME.mean_mm) / np.sqrt(3.0)
    # The residuals of n points have 3 n - 6 freedoms.
    std_mm = residual_mm * np.sqrt(len(to_mm) / (3 * len(to_mm) - 6))
    for _ in range(_N_DRAWS):
        drawn = _aligned(title, to_mm, true, rng.normal(0.0, std_mm, to_mm.shape))
        fitted = drawn["alignment"]
        alignment = Helmert(
            np.array(fitted["rotation"]), np.array(fitted["translation_mm"])
        )
        off_mm = alignment.places_mm(true.inverse().places_mm(places_mm)) - places_mm
        squares.append(np.mean(np.sum(off_mm**2, axis=1)))
    return Example(
        title, values, _residual_mm(values), float(np.sqrt(np.mean(squares)))
    )


def _residual_mm(values: dict[str, Any]) -> float:
    lengths = [point["residual_length_mm"] for point in values["points"]]
    return float(np.sqrt(np.mean(np.square(lengths))))


def _aligned(
    title: str, to_mm: Floats, true: Helmert, errors_mm: Floats
) -> dict[str, Any]:
    from_mm = true.inverse().places_mm(to_mm) + errors_mm
    common = CommonPoints(
        ("A", "B", "C", "D"),
        tuple(Place(place, None) for place in from_mm),
        tuple(Place(place, None) for place in to_mm),
    )
    alignment = best_fit_alignment(common, fixed_volume(VOLUME), "of the example")
    return alignment_values(alignment, name=title, arm=None, measured="", nominal="")


_WIDTH_MM = 165.0
_N_BINS = 12
_FACTOR = 900.0  # of both examples, so that they can be compared


def paint(outcomes: Sequence[Outcome], folder: Path) -> None:
    """Write alignment-*.png, and print the figures of the example."""
    folder.mkdir(parents=True, exist_ok=True)
    truth = picture(_WIDTH_MM, 75.0, lambda figure: _prediction(outcomes, figure))
    (folder / "alignment-prediction.png").write_bytes(truth)
    index = picture(_WIDTH_MM, 75.0, lambda figure: _index(outcomes, figure))
    (folder / "alignment-index.png").write_bytes(index)
    for name, example in zip(("line", "wide"), examples(), strict=True):
        _print_example(example)
        png = picture(
            _WIDTH_MM,
            65.0,
            lambda figure, values=example.values: ellipsoids(values, figure, _FACTOR),
        )
        (folder / f"alignment-{name}.png").write_bytes(png)


def _print_example(example: Example) -> None:
    values = example.values
    quality = values["quality"]
    error = quality["predicted_error_mm"]
    print(
        f"\n{example.title}: residuals {example.residual_mm:.4f} mm rms, sigma0 "
        f"{values['sigma0']:.4f} mm, index {quality['index']['rms']:.2f} rms "
        f"{quality['index']['max']:.2f} max, predicted {error['rms']:.4f} mm rms "
        f"{error['max']:.4f} mm max, true {example.true_mm:.4f} mm rms; flags "
        f"{', '.join(flag['code'] for flag in values['flags'])}"
    )


def _prediction(outcomes: Sequence[Outcome], figure: Figure) -> None:
    left, right = figure.subplots(1, 2)
    usable = [outcome for outcome in outcomes if not outcome.refused]
    predicted = np.array([outcome.predicted_mm for outcome in usable])
    observed = np.array([outcome.observed_mm for outcome in usable])
    _dots(left, predicted, observed)
    ends = [predicted.min(), predicted.max()]
    left.plot(ends, ends, color="black", linewidth=0.9)
    left.set_xlabel("predicted error in the volume [mm]")
    left.set_ylabel("observed error [mm]")
    edges = np.quantile(predicted, np.linspace(0.0, 1.0, _N_BINS + 1))
    bin_number = np.clip(np.searchsorted(edges, predicted) - 1, 0, _N_BINS - 1)
    squares = (observed / predicted) ** 2
    middles, ratios, bars = [], [], []
    for number in range(_N_BINS):
        part = squares[bin_number == number]
        ratio = np.sqrt(part.mean())
        middles.append(np.median(predicted[bin_number == number]))
        ratios.append(ratio)
        bars.append(part.std() / np.sqrt(len(part)) / (2.0 * ratio))
    right.axhspan(0.95, 1.05, color=GREY, alpha=0.2)
    right.axhline(1.0, color="black", linewidth=0.9)
    right.errorbar(middles, ratios, yerr=bars, fmt="o", color=BLUE, markersize=3.5)
    right.set_xscale("log")
    right.set_ylim(0.85, 1.15)
    right.set_xlabel("predicted error in the volume [mm]")
    right.set_ylabel("observed / predicted, rms")


def _index(outcomes: Sequence[Outcome], figure: Figure) -> None:
    left, right = figure.subplots(1, 2, sharey=True)
    true = np.array([outcome.true_mm for outcome in outcomes])
    _dots(left, np.array([outcome.index for outcome in outcomes]), true)
    left.set_xlabel("disposition index")
    left.set_ylabel("true error in the volume [mm]")
    _dots(right, np.array([outcome.fit_mm for outcome in outcomes]), true, VERMILION)
    right.set_xscale("linear")
    right.set_xlabel("residuals of the fit, rms [mm]")


def _dots(axes: Axes, x: np.ndarray, y: np.ndarray, color: str = BLUE) -> None:
    axes.plot(x, y, ".", markersize=1.5, alpha=0.3, color=color, rasterized=True)
    axes.set_xscale("log")
    axes.set_yscale("log")
