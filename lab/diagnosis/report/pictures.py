"""Pictures of a diagnosis: the ledger, and each term over what matters for it."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from traverse.arrays import Booleans, Floats
from traverse.lab.diagnosis.model.result import Diagnosis
from traverse.lab.diagnosis.report.names import step_names
from traverse.lab.diagnosis.report.term_curve import TermCurve
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

# Poses that say so much less than usual are no dots; means weigh all.
_NOISY = 3.0
_LONGEST_NAME = 44


def ledger_picture(diagnosis: Diagnosis) -> bytes | None:
    """Draw the gap after every term; None: no poses were kept aside."""
    if diagnosis.gap.before.n == 0:
        return None
    height_mm = 22.0 + 9.0 * len(diagnosis.ledger)
    return picture(180.0, height_mm, _paint_ledger, diagnosis)


def term_picture(curve: TermCurve, shown: Booleans) -> bytes:
    """Draw a term: what was left over before and after, and the term itself."""
    return picture(180.0, 68.0, _paint_term, curve, shown)


def _paint_ledger(figure: Figure, diagnosis: Diagnosis) -> None:
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(1.0, 1.0))
    names = step_names(diagnosis)
    rows = np.arange(len(names))
    rms_mm = np.array([step.held_out.rms_mm for step in diagnosis.ledger])
    factor, unit = shown_unit(float(np.max(rms_mm, initial=0.0)), "mm")
    left.barh(rows, factor * rms_mm, height=0.55, color=BLUE)
    _write_values(left, factor * rms_mm, f" {unit}", 3.0)
    left.set_xlim(0.0, 1.28 * float(np.max(factor * rms_mm, initial=1e-9)))
    left.set_xlabel(f"held-out rms [{unit}]")
    most = _LONGEST_NAME
    short = [n if len(n) <= most else f"{n[: most - 1]}…" for n in names]
    left.set_yticks(rows, short)
    left.invert_yaxis()
    chi2 = np.array([step.held_out.chi2 for step in diagnosis.ledger])
    right.plot(chi2, rows, color=BLUE, marker="o", markersize=5.0, linewidth=1.0)
    _write_values(right, chi2, "", 6.0)
    right.axvline(1.0, color=ORANGE, linewidth=1.2, linestyle="--")
    top = float(np.max(chi2, initial=1.0))
    if top > 10.0:
        right.set_xscale("log")
        right.set_xlim(min(0.7, 0.8 * float(chi2.min())), 2.0 * top)
    else:
        right.set_xlim(0.0, 1.2 * max(top, 1.0))
    right.set_xlabel("held-out misfit; dashed: noise alone")


def _write_values(axes: Axes, values: Floats, unit: str, right_points: float) -> None:
    """Write the value of each row beside its end."""
    for row, value in enumerate(values):
        axes.annotate(
            f"{value:.3g}{unit}",
            (value, row),
            xytext=(right_points, 0.0),
            textcoords="offset points",
            va="center",
            fontsize=7.0,
        )


def _paint_term(figure: Figure, curve: TermCurve, shown: Booleans) -> None:
    left, right = figure.subplots(1, 2)
    x = curve.covariate.values
    seen = shown & np.isfinite(x) & np.isfinite(curve.stds)
    with_term = curve.after + curve.fitted
    limits = [
        1.5 * symmetric_limit(binned(x[seen], one[seen], curve.stds[seen]).means, 1.0)
        for one in (curve.before, with_term)
    ]
    limits[1] = max(limits[1], 1.3 * symmetric_limit(curve.fitted[seen], 1.0))
    factor, unit = shown_unit(max(limits), curve.unit)
    usual = float(np.median(curve.stds[seen])) if np.any(seen) else 1.0
    clear = seen & (curve.stds < _NOISY * usual)
    dots = thinned(np.flatnonzero(clear))
    for axes, limit in zip((left, right), limits, strict=True):
        zero_line(axes)
        axes.set_xlabel(curve.covariate.label)
        axes.set_ylim(-factor * limit, factor * limit)
    left.set_ylabel(f"{curve.what} [{unit}]")
    for values, colour, mark, label in (
        (curve.before, VERMILION, "s", "before, without any term"),
        (curve.after, BLUE, "o", "after, with all terms"),
    ):
        _scattered(left, x[dots], factor * values[dots], colour)
        means = binned(x[seen], factor * values[seen], curve.stds[seen])
        draw_means(left, means, (colour, mark, label))
    left.set_title("what is left over")
    left.legend(loc="best")
    _scattered(right, x[dots], factor * with_term[dots], GREY)
    order = np.flatnonzero(seen)[np.argsort(x[seen], kind="stable")]
    fitted, band = factor * curve.fitted[order], 2.0 * factor * curve.band[order]
    if curve.covariate.is_function:
        right.fill_between(
            x[order], fitted - band, fitted + band, color=ORANGE, alpha=0.45, lw=0.0
        )
        right.plot(x[order], fitted, color="black", linewidth=1.2, label="the term")
    else:
        right.scatter(
            x[order],
            fitted,
            s=12.0,
            marker="+",
            color="black",
            linewidths=0.6,
            label="the term",
        )
    look = (VERMILION, "s", "data, all else modelled")
    means = binned(x[seen], factor * with_term[seen], curve.stds[seen])
    draw_means(right, means, look)
    right.set_title("the term ± 2 sigma, and what the data say")
    right.legend(loc="best")


def _scattered(axes: Axes, x: Floats, y: Floats, colour: str) -> None:
    low, high = axes.get_ylim()
    inside = (y > low) & (y < high)
    axes.scatter(
        x[inside],
        y[inside],
        s=0.5 * dot_size(len(x)),
        color=colour,
        alpha=0.25,
        linewidths=0.0,
    )
