"""What must be established before a daily check is in control.

Strategy: a chart of few checks has limits that are as wide as chance makes them, metres
after two checks, and everything lies within. It judges from when its limits are
narrower than what is permitted; until then only a stated permissible error does.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from traverse.lab.outcomes.base import (
    Condition,
    Established,
    Finding,
    Outcome,
    Shortfall,
    State,
    judge,
)
from traverse.plurals import counted

WORDS = {
    State.GOOD: "in control",
    State.DOUBT: "NOT JUDGED YET",
    State.BAD: "OUT OF CONTROL",
}
_STATE_LIMITS = (
    "State the arm's permissible errors with --limits or --acceptance, or check again."
)


@dataclass(frozen=True, slots=True)
class JudgedFigure:
    """A figure of the last check, beside its chart and what is permitted.

    Attributes:
        permissible_mm: Largest error; as stated, else as the arm's uncertainty allows,
            else as assumed.
        is_stated: Whether it is.
        is_of_arm: Whether the arm states its uncertainty.
        plausible_mm: Beyond it not the arm is off, but something else was touched.
        half_width_mm: Of the chart's limits; None where there are too few checks.
        alarms: Rules of the chart that it breaks.
        drift_mm: Change from check to check since the base began; None: none is seen.
    """

    name: str
    value_mm: float
    permissible_mm: float
    is_stated: bool
    is_of_arm: bool
    plausible_mm: float
    half_width_mm: float | None
    alarms: tuple[str, ...]
    drift_mm: float | None

    @property
    def chart_judges(self) -> bool:
        """Whether the chart's limits are narrower than what is permitted."""
        width_mm = self.half_width_mm
        return width_mm is not None and width_mm <= self.permissible_mm

    @property
    def exceeds(self) -> bool:
        """Whether it is beyond what is permitted."""
        return abs(self.value_mm) > self.permissible_mm


@dataclass(frozen=True, slots=True)
class DailyCheckEvidence:
    """Figures of the last check, and what is not as at the check before.

    Attributes:
        changes: In sentences, each with its remedy.
    """

    figures: Sequence[JudgedFigure]
    n_checks: int
    changes: Sequence[tuple[str, str]]


def _um(mm: float) -> str:
    return f"{1000.0 * mm:.1f} µm"


def _values(figure: JudgedFigure) -> dict[str, object]:
    return {
        "figure": figure.name,
        "value_mm": figure.value_mm,
        "permissible_mm": figure.permissible_mm,
        "is_stated": figure.is_stated,
        "half_width_mm": figure.half_width_mm,
    }


def _plausible(check: DailyCheckEvidence) -> Finding:
    return [
        Shortfall(
            f"{figure.name}: {_um(figure.value_mm)} is beyond the plausible "
            f"{_um(figure.plausible_mm)}.",
            "See whether the right seat and sphere were touched, and check again.",
            _values(figure),
            State.BAD,
        )
        for figure in check.figures
        if abs(figure.value_mm) > figure.plausible_mm
    ] or Established()


def _permitted(check: DailyCheckEvidence) -> Finding:
    return [
        Shortfall(
            f"{figure.name}: {_um(figure.value_mm)} is beyond the permitted "
            f"{_um(figure.permissible_mm)}.",
            "Check again; if it stays so, do not measure before the arm is identified "
            "or repaired.",
            _values(figure),
            State.BAD,
        )
        for figure in check.figures
        if figure.is_stated and figure.exceeds
    ] or Established()


def _no_alarm(check: DailyCheckEvidence) -> Finding:
    return [
        Shortfall(
            f"{figure.name}: {name}.",
            "Check again; if it stays so, look for what has changed.",
            {**_values(figure), "rule": name},
            State.BAD,
        )
        for figure in check.figures
        for name in figure.alarms
    ] or Established()


def _steady(check: DailyCheckEvidence) -> Finding:
    return [
        Shortfall(
            f"{figure.name}: it drifts by {_um(figure.drift_mm)} a check since the "
            "base began.",
            "Look for what wears, loosens or warms up; begin a new base when it is "
            "found.",
            {**_values(figure), "drift_mm": figure.drift_mm},
            State.BAD,
        )
        for figure in check.figures
        if figure.drift_mm is not None
    ] or Established()


def _judged(check: DailyCheckEvidence) -> Finding:
    return [
        Shortfall(
            _why_not_judged(figure, check.n_checks), _STATE_LIMITS, _values(figure)
        )
        for figure in check.figures
        if not figure.is_stated and not (figure.chart_judges and not figure.exceeds)
    ] or Established({"n_checks": check.n_checks})


def _why_not_judged(figure: JudgedFigure, n_checks: int) -> str:
    if figure.exceeds:
        return (
            f"{figure.name}: {_um(figure.value_mm)} is beyond the "
            f"{_um(figure.permissible_mm)} {_origin(figure)}: no base for later checks."
        )
    if figure.half_width_mm is None:
        return (
            f"{figure.name}: the chart judges from the third check on, or later; "
            f"{counted(n_checks, 'check')} since the base began."
        )
    return (
        f"{figure.name}: the chart's limits are {_um(figure.half_width_mm)} wide, more "
        f"than the {_um(figure.permissible_mm)} {_origin(figure)}: they judge nothing "
        "yet."
    )


def _origin(figure: JudgedFigure) -> str:
    if figure.is_of_arm:
        return "that the arm's stated uncertainty allows"
    return "that are assumed where nothing is stated"


def _comparable(check: DailyCheckEvidence) -> Finding:
    return [Shortfall(text, remedy) for text, remedy in check.changes] or Established()


CONDITIONS: tuple[Condition[DailyCheckEvidence], ...] = (
    Condition("plausible", "the right seat and sphere were touched", _plausible),
    Condition("permitted", "no figure is beyond what is permitted", _permitted),
    Condition("control", "no rule of a chart is broken", _no_alarm),
    Condition("steady", "no figure drifts from check to check", _steady),
    Condition("judged", "charts or permissible errors judge every figure", _judged),
    Condition("comparable", "it was done as at the check before", _comparable),
)


def daily_check_outcome(evidence: DailyCheckEvidence) -> Outcome:
    return judge(CONDITIONS, evidence)
