"""How pictures are made: one look, PNG bytes, no global state of matplotlib.

Colours are Okabe and Ito's, which the colour-blind can distinguish; whatever matters
also differs in shape.
"""

import io
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from traverse.arrays import Floats, Integers

Paint = Callable[[Figure], None]
# Colour, mark, and label of the legend.
Look = tuple[str, str, str | None]

BLUE, ORANGE, VERMILION, GREY = "#0072B2", "#E69F00", "#D55E00", "#707070"
# Of the box of a verdict; as in frame.jinja.
STATE_COLOURS = {"good": BLUE, "doubt": ORANGE, "bad": VERMILION, "open": GREY}
# More dots are not visible, and the page stays small.
MOST_DOTS = 12_000

# Means over parts of a range, where single poses are too noisy to look at.
_MOST_BINS = 24
_LEAST_IN_A_BIN = 5
# Few different values are groups by themselves: senses of approach, features.
_GROUPS = 6

_INCHES_PER_MM = 1.0 / 25.4
_DPI = 120
# A higher level takes four times as long and saves a twentieth.
_PNG_COMPRESSION = 3
# Widths of letters of labels, on average and rather too much.
_MM_PER_LETTER = 1.55
_MOST_MM_OF_LABELS = 70.0
_SEED = 1
_LOOK = mpl.rc_params_from_file(
    Path(__file__).with_name("look.mplstyle"), use_default_template=False
)


def picture(
    width_mm: float, height_mm: float, paint: Callable[..., None], *what: object
) -> bytes:
    """Paint what is given into a figure of a size and return it as PNG."""
    with mpl.rc_context(_LOOK):
        figure = Figure(
            figsize=(width_mm * _INCHES_PER_MM, height_mm * _INCHES_PER_MM),
            layout="constrained",
            dpi=_DPI,
        )
        paint(figure, *what)
        file = io.BytesIO()
        # savefig would draw everything twice, once for the layout alone. No name of
        # the program: it holds an address of the web.
        canvas = FigureCanvasAgg(figure)
        canvas.print_png(  # type: ignore[no-untyped-call] # by matplotlib
            file,
            metadata={"Software": None},
            pil_kwargs={"compress_level": _PNG_COMPRESSION},
        )
    return file.getvalue()


@dataclass(frozen=True, slots=True)
class Margins:
    """Room around axes for their labels and titles, and between them [mm]."""

    left: float
    bottom: float
    top: float = 4.0
    right: float = 4.0
    between_columns: float = 0.0
    between_rows: float = 0.0


def axes_grid(
    figure: Figure, margins: Margins, n_rows: int = 1, n_columns: int = 1
) -> list[list[Axes]]:
    """Make axes in rows and columns, with a fixed room around them.

    Strategy: a layout that measures labels takes as long as all else of a picture. The
    sizes of a picture and of its letters are known, so that none is needed.
    """
    width_mm, height_mm = figure.get_size_inches() / _INCHES_PER_MM
    figure.set_layout_engine("none")
    free_mm = np.array(
        [
            width_mm - margins.left - margins.right,
            height_mm - margins.bottom - margins.top,
        ]
    )
    gaps_mm = np.array([margins.between_columns, margins.between_rows])
    counts = np.array([n_columns, n_rows])
    wide, high = gaps_mm * counts / (free_mm - gaps_mm * (counts - 1))
    grid = figure.subplots(
        n_rows,
        n_columns,
        squeeze=False,
        gridspec_kw={
            "left": margins.left / width_mm,
            "right": 1.0 - margins.right / width_mm,
            "bottom": margins.bottom / height_mm,
            "top": 1.0 - margins.top / height_mm,
            "wspace": wide,
            "hspace": high,
        },
    )
    rows: list[list[Axes]] = grid.tolist()
    return rows


def labels_mm(names: Iterable[str]) -> float:
    """Return how much room names need at an axis."""
    longest = max(map(len, names), default=0)
    return min(_MM_PER_LETTER * longest + 4.0, _MOST_MM_OF_LABELS)


def painted(
    paintings: Iterable[tuple[str, float, Paint]], width_mm: float
) -> list[tuple[str, bytes]]:
    """Paint figures given by title, height in mm, and how: pairs of title and PNG."""
    return [
        (title, picture(width_mm, height_mm, paint))
        for title, height_mm, paint in paintings
    ]


def thinned(poses: Integers) -> Integers:
    """Take a random part of too many poses, always the same one."""
    if len(poses) <= MOST_DOTS:
        return poses
    chosen = np.random.default_rng(_SEED).choice(len(poses), MOST_DOTS, replace=False)
    return poses[np.sort(chosen)]


def draw_dots(
    axes: Axes, x: Floats, y: Floats, look: Look, alpha: float, *, size: float = 1.0
) -> None:
    """Draw poses as marks without rims, larger ones where there are few."""
    colour, mark, label = look
    axes.scatter(
        x,
        y,
        s=size * float(np.clip(200.0 / np.sqrt(len(x) + 1.0), 4.0, 14.0)),
        color=colour,
        marker=mark,
        alpha=alpha,
        linewidths=0.0,
        label=label,
    )


def symmetric_limit(values: Floats, part: float = 0.999) -> float:
    """Return how far an axis about zero has to go to show this part of values."""
    finite = np.abs(values[np.isfinite(values)])
    if len(finite) == 0:
        return 1.0
    limit = 1.15 * float(np.quantile(finite, part))
    return limit if limit > 0.0 else 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Bins:
    """Means over parts of a range and their standard errors, each (n_bins,)."""

    centres: Floats
    means: Floats
    errors: Floats


def binned(covariate: Floats, values: Floats, stds: Floats | None = None) -> Bins:
    """Average values over parts of a covariate's range with equally many poses.

    Values and covariate are (n_poses,), NaN where unknown; their standard deviations
    are weights, default equal ones.
    """
    weights = np.ones_like(values) if stds is None else 1.0 / stds**2
    good = np.isfinite(covariate) & np.isfinite(values) & np.isfinite(weights)
    x, y, w = covariate[good], values[good], weights[good]
    if len(x) == 0:
        return Bins(np.empty(0), np.empty(0), np.empty(0))
    groups, places = np.unique(x, return_inverse=True)
    if len(groups) > _GROUPS:
        n_bins = int(np.clip(len(x) // (2 * _LEAST_IN_A_BIN), 1, _MOST_BINS))
        order = np.argsort(x, kind="stable")
        places = np.empty(len(x), dtype=np.int64)
        places[order] = np.arange(len(x)) * n_bins // len(x)
    n_bins = int(places.max()) + 1
    total = np.bincount(places, w, n_bins)
    means = np.bincount(places, w * y, n_bins) / total
    centres = np.bincount(places, w * x, n_bins) / total
    counts = np.bincount(places, minlength=n_bins)
    squares = np.bincount(places, w * (y - means[places]) ** 2, n_bins) / total
    kept = counts > 1
    errors = np.sqrt(squares[kept] / (counts[kept] - 1))
    return Bins(centres[kept], means[kept], errors)


def draw_means(axes: Axes, bins: Bins, look: Look, factor: float = 1.0) -> None:
    """Draw means over parts of a range, with two standard errors."""
    colour, mark, label = look
    axes.errorbar(
        bins.centres,
        factor * bins.means,
        yerr=2.0 * factor * bins.errors,
        color=colour,
        fmt=mark,
        markersize=2.8,
        linewidth=0.9,
        label=label,
    )


def zero_line(axes: Axes) -> None:
    """Draw where nothing is left over."""
    axes.axhline(0.0, color=GREY, linewidth=0.7)
