"""The pictures of docs/alignment.md, of what `benchmarks.alignment.__main__` found."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.alignment.example import Example, examples
from benchmarks.alignment.point_distributions import Outcome
from traverse.lab.alignment.pictures import ellipsoids_painting
from traverse.lab.report.figures import (
    BLUE,
    GREY,
    VERMILION,
    picture,
)

_WIDTH_MM = 165.0
_N_BINS = 12
_FACTOR = 900.0  # of both examples, so that they can be compared


def paint(found: Sequence[Outcome], folder: Path) -> None:
    """Write alignment-*.png, and print the figures of the example."""
    folder.mkdir(parents=True, exist_ok=True)
    truth = picture(_WIDTH_MM, 75.0, lambda figure: _prediction(found, figure))
    (folder / "alignment-prediction.png").write_bytes(truth)
    index = picture(_WIDTH_MM, 75.0, lambda figure: _index(found, figure))
    (folder / "alignment-index.png").write_bytes(index)
    for name, example in zip(("line", "wide"), examples(), strict=True):
        _tell(example)
        painted = ellipsoids_painting(example.values, _FACTOR)
        png = picture(_WIDTH_MM, 65.0, painted)
        (folder / f"alignment-{name}.png").write_bytes(png)


def _tell(example: Example) -> None:
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


def _prediction(found: Sequence[Outcome], figure: Figure) -> None:
    left, right = figure.subplots(1, 2)
    usable = [one for one in found if not one.refused]
    predicted = np.array([one.predicted_mm for one in usable])
    observed = np.array([one.observed_mm for one in usable])
    _dots(left, predicted, observed)
    ends = [predicted.min(), predicted.max()]
    left.plot(ends, ends, color="black", linewidth=0.9)
    left.set_xlabel("predicted error in the volume [mm]")
    left.set_ylabel("observed error [mm]")
    edges = np.quantile(predicted, np.linspace(0.0, 1.0, _N_BINS + 1))
    which = np.clip(np.searchsorted(edges, predicted) - 1, 0, _N_BINS - 1)
    squares = (observed / predicted) ** 2
    middles, ratios, bars = [], [], []
    for number in range(_N_BINS):
        part = squares[which == number]
        ratio = np.sqrt(part.mean())
        middles.append(np.median(predicted[which == number]))
        ratios.append(ratio)
        bars.append(part.std() / np.sqrt(len(part)) / (2.0 * ratio))
    right.axhspan(0.95, 1.05, color=GREY, alpha=0.2)
    right.axhline(1.0, color="black", linewidth=0.9)
    right.errorbar(middles, ratios, yerr=bars, fmt="o", color=BLUE, markersize=3.5)
    right.set_xscale("log")
    right.set_ylim(0.85, 1.15)
    right.set_xlabel("predicted error in the volume [mm]")
    right.set_ylabel("observed / predicted, rms")


def _index(found: Sequence[Outcome], figure: Figure) -> None:
    left, right = figure.subplots(1, 2, sharey=True)
    true = np.array([one.true_mm for one in found])
    _dots(left, np.array([one.index for one in found]), true)
    left.set_xlabel("disposition index")
    left.set_ylabel("true error in the volume [mm]")
    _dots(right, np.array([one.fit_mm for one in found]), true, VERMILION)
    right.set_xscale("linear")
    right.set_xlabel("residuals of the fit, rms [mm]")


def _dots(axes: Axes, x: np.ndarray, y: np.ndarray, color: str = BLUE) -> None:
    axes.plot(x, y, ".", markersize=1.5, alpha=0.3, color=color, rasterized=True)
    axes.set_xscale("log")
    axes.set_yscale("log")
