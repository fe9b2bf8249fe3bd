"""The digital read-out: position of the probe, and its uncertainty."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from nicegui import ui

from traverse.client.display.arm_state import ArmSight
from traverse.client.display.figures import (
    GEOMETRY_UNKNOWN,
    MM,
    SYSTEMS,
    TIME_UNKNOWN,
    System,
    Unit,
    expanded_axes_mm,
    flag_words,
    is_geometry_unknown,
    label_words,
    place_mm,
    place_uncertainty,
)
from traverse.client.display.nominal import Nominal
from traverse.protocol.messages import Live, Point

NAMES = ("X", "Y", "Z")
OF_LAST_POINT = "± is k = 2, of the last point"


@dataclass(slots=True)
class Choices:
    """The operator's choice of display; a newly opened page begins with it.

    Attributes:
        of_part: part coordinates are shown if there is an alignment.
        nominal: nominal place; None: no deviation is shown.
        scan_spacing_mm: distance between points of a scan; None: by time.
    """

    unit: Unit = MM
    of_part: bool = True
    nominal: Nominal | None = None
    scan_spacing_mm: float | None = None

    def system(self, sight: ArmSight) -> System:
        return "part" if self.of_part and sight.is_aligned else "arm"

    def system_words(self, sight: ArmSight) -> str:
        """Return the name of the system, the part's with its alignment."""
        system = self.system(sight)
        named = system == "part" and sight.status and sight.status.alignment
        return f"{SYSTEMS[system]}, {named}" if named else SYSTEMS[system]


class Figures:
    """Large figures, readable from afar."""

    def __init__(self, choices: Choices) -> None:
        self._choices = choices
        self._values: list[ui.label] = []
        self._around: list[ui.label] = []
        with ui.element("section").classes("panel figures") as self._panel:
            self._panel.props('aria-label="Position of the probe"')
            self._system = ui.label().classes("system")
            for name in NAMES:
                with ui.element("div").classes("axis"):
                    ui.label(name).classes("name")
                    self._values.append(ui.label("-").classes("value"))
                    self._around.append(ui.label().classes("around"))
            self._deviation = ui.html("", sanitize=False).classes("deviation")
            with ui.element("div").classes("under"):
                self._doubt = ui.label().classes("doubt")
                self._note = ui.label()
                self._speed = ui.label()
                self._temperature = ui.label()
            ui.label("STALE").classes("stale-word").props('aria-hidden="true"')

    def show(self, sight: ArmSight) -> None:
        stale = sight.is_stale
        self._panel.classes("stale" if stale else "", remove="stale")
        live, unit = sight.live, self._choices.unit
        if live is None:
            return
        system = self._choices.system(sight)
        xyz_mm = place_mm(live, system) or live.xyz_mm
        around_mm, source = _expanded(live, sight.last_point, system)
        self._system.set_text(f"Ball centre, {self._choices.system_words(sight)}")
        for axis, (value, around) in enumerate(
            zip(self._values, self._around, strict=True)
        ):
            value.set_text(unit.text(xyz_mm[axis]))
            known = "" if around_mm is None else f"\n± {unit.text(around_mm[axis])}"
            around.set_text(f"{unit.name}{known}")
        self._note.set_text(source)
        speed = live.speed_mm_s
        speed_words = (
            "" if speed is None else f"{speed * unit.per_mm:.0f} {unit.name}/s"
        )
        self._speed.set_text(speed_words)
        health = None if sight.is_health_stale else sight.health
        temperature_c = health.temperatures_c.get("arm") if health else None
        temperature = "" if temperature_c is None else f"{temperature_c:.1f} °C"
        self._temperature.set_text(temperature)
        self._doubt.set_text("" if live.quality.ok else f"In doubt: {flag_words(live)}")
        shown = "" if stale else self._step(sight, system) + self._bars(sight, system)
        self._deviation.set_content(shown)

    def _step(self, sight: ArmSight, system: System) -> str:
        """Difference of the probe's place from the last point; "" without one."""
        live, last, unit = sight.live, _last_point(sight, system), self._choices.unit
        live_mm = None if live is None else place_mm(live, system)
        last_mm = None if last is None else place_mm(last, system)
        if last is None or live_mm is None or last_mm is None:
            return ""
        step_mm = np.subtract(live_mm, last_mm)
        return (
            f'<div class="step"><span>from point {last.seq}</span>'
            f"<span>{_offsets_text(step_mm.tolist(), unit)}</span>"
            f"<b>{unit.with_name(float(np.linalg.norm(step_mm)))}</b></div>"
        )

    def _bars(self, sight: ArmSight, system: System) -> str:
        """Deviation of the probe and of the last point from the nominal place."""
        nominal, unit = self._choices.nominal, self._choices.unit
        rows = []
        last = _last_point(sight, system)
        for name, of in (("now", sight.live), ("last point", last)):
            place = None if of is None else place_mm(of, system)
            if nominal is None or of is None or place is None:
                continue
            # Any direction. That of the alignment is not known.
            around_mm = None if system == "part" else expanded_axes_mm(of, "part")
            doubt = "" if of.quality.ok else flag_words(of)
            off = nominal.deviation(place, around_mm[0] if around_mm else None, doubt)
            level, words = off.decision
            offsets = _offsets_text(off.offsets_mm, unit)
            share = min(off.distance_mm / (2.0 * nominal.tolerance_mm), 1.0)
            rows.append(
                f'<div class="nominal {level}"><span>{name}</span>'
                f"<span>{offsets}</span>"
                f'<div class="tolerance"><div style="width:{share:.1%}"></div></div>'
                f"<b>{unit.text(off.distance_mm)} of {unit.text(nominal.tolerance_mm)} "
                f"{unit.name}: {words}</b></div>"
            )
        return "".join(rows)


def _last_point(sight: ArmSight, system: System) -> Point | None:
    """Return the last point, if it has a place in the system as it is now."""
    last = sight.last_point
    is_of_before = system == "part" and last and last.time_ns < sight.aligned_ns
    return None if is_of_before else last


def _offsets_text(offsets_mm: Sequence[float | None], unit: Unit) -> str:
    """Format differences of coordinates; None: the axis is left out."""
    return "  ".join(
        f"Δ{axis} {unit.text(offset, sign=True)}"
        for axis, offset in zip(NAMES, offsets_mm, strict=True)
        if offset is not None
    )


def _expanded(
    live: Live, point: Point | None, system: System
) -> tuple[list[float] | None, str]:
    if is_geometry_unknown(live):
        return None, f"U: {GEOMETRY_UNKNOWN}"
    if live.covariance_mm2 is not None:
        return expanded_axes_mm(live, system), "± is k = 2"
    if "time_uncertain" in live.quality.flags:
        return None, f"U: {TIME_UNKNOWN}"
    around_mm = expanded_axes_mm(point, system)
    return around_mm, "± not known" if around_mm is None else OF_LAST_POINT


def point_rows(
    points: list[Point],
    newest: str | None,
    system: System = "arm",
    unit: Unit = MM,
    aligned_ns: int = 0,
) -> str:
    """Return rows of the table of points, newest first, as HTML."""
    rows = []
    for point in reversed(points):
        place = place_mm(point, system)
        remarks = flag_words(point)
        if system == "part" and (place is None or point.time_ns < aligned_ns):
            place, remarks = None, f"{remarks} of before the alignment".strip()
        shown = ("-",) * 3 if place is None else map(unit.text, place)
        around = place_uncertainty(point, unit)
        kind = "" if point.quality.ok else "doubt"
        if point.id == newest:
            kind += " new"
        cells = "".join(f"<td>{value}</td>" for value in (point.seq, *shown, around))
        rows.append(
            f'<tr class="{kind}">{cells}<td class="text" translate="no">'
            f"{escape(label_words(point))}"
            f'</td><td class="text">{escape(remarks)}</td></tr>'
        )
    axes = "".join(f"<th>{axis} {unit.name}</th>" for axis in "xyz")
    return (
        f'<table class="plain"><thead><tr><th>no.</th>{axes}<th>U, k=2</th>'
        '<th class="text">label</th><th class="text">remarks</th></tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table>"
    )
