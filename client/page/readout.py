"""The digital read-out: where the probe is, and how well that is known."""

from html import escape

import numpy as np
from nicegui import ui

from traverse.client.display.arm_state import ArmSight
from traverse.protocol.messages import Live, Point

DIAGONAL = (0, 3, 5)  # of xx, xy, xz, yy, yz, zz
NAMES = ("X", "Y", "Z")


class Figures:
    """Large figures, readable from afar.

    Attributes:
        of_part: part coordinates are shown where there are any.
    """

    def __init__(self) -> None:
        self.of_part = True
        self._values: list[ui.label] = []
        self._around: list[ui.label] = []
        with ui.element("section").classes("panel figures") as self._panel:
            self._panel.props('aria-label="Position of the probe"')
            for name in NAMES:
                with ui.element("div").classes("axis"):
                    ui.label(name).classes("name")
                    self._values.append(ui.label("-").classes("value"))
                    self._around.append(ui.label("mm").classes("around"))
            with ui.element("div").classes("under"):
                self._system = ui.label()
                self._speed = ui.label()
                self._temperature = ui.label()
                self._doubt = ui.label().classes("doubt")
            ui.label("STALE").classes("stale-word").props('aria-hidden="true"')

    def show(self, sight: ArmSight) -> None:
        """Show what is known now."""
        stale = sight.is_stale
        self._panel.classes(
            add="stale" if stale else "", remove="" if stale else "stale"
        )
        live = sight.live
        if live is None:
            return
        part_mm = live.part_xyz_mm if self.of_part else None
        xyz_mm = live.xyz_mm if part_mm is None else part_mm
        around_mm = _expanded_mm(live, sight.last_point)
        for axis, (value, around) in enumerate(
            zip(self._values, self._around, strict=True)
        ):
            value.set_text(f"{xyz_mm[axis]:.3f}")
            known = "" if around_mm is None else f"\n± {around_mm[axis]:.3f}"
            around.set_text(f"mm{known}")
        system = "arm's system" if part_mm is None else "part's system"
        self._system.set_text(system if around_mm is None else f"{system}, ± is k = 2")
        speed = "" if live.speed_mm_s is None else f"{live.speed_mm_s:.0f} mm/s"
        self._speed.set_text(speed)
        health = sight.health
        temperature_c = health.temperatures_c.get("arm") if health else None
        told = "" if temperature_c is None else f"{temperature_c:.1f} °C"
        self._temperature.set_text(told)
        flags = "" if live.quality.ok else ", ".join(live.quality.flags)
        self._doubt.set_text(flags.replace("_", " "))


def _expanded_mm(live: Live, point: Point | None) -> list[float] | None:
    """Twice the standard deviation of each coordinate, k = 2; of the pose if known."""
    covariance = live.covariance_mm2
    if covariance is None and point is not None:
        covariance = point.covariance_mm2
    if covariance is None:
        return None
    return [2.0 * float(np.sqrt(max(covariance[i], 0.0))) for i in DIAGONAL]


def point_rows(points: list[Point], newest: str | None) -> str:
    """Rows of the table of points, newest first, as HTML."""
    rows = []
    for point in reversed(points):
        x_mm, y_mm, z_mm = point.xyz_mm
        around = ""
        if point.covariance_mm2 is not None:
            trace = sum(point.covariance_mm2[i] for i in DIAGONAL)
            around = f"{2.0 * np.sqrt(max(trace, 0.0)):.3f}"
        label = " ".join(filter(None, (point.label.artefact, point.label.feature)))
        flags = ", ".join(point.quality.flags).replace("_", " ")
        kind = "" if point.quality.ok else "doubt"
        if point.id == newest:
            kind += " new"
        rows.append(
            f'<tr class="{kind}"><td>{point.seq}</td><td>{x_mm:.3f}</td>'
            f"<td>{y_mm:.3f}</td><td>{z_mm:.3f}</td><td>{around}</td>"
            f'<td class="text">{escape(label)}</td>'
            f'<td class="text">{escape(flags)}</td></tr>'
        )
    return (
        '<table class="plain"><thead><tr><th>no.</th><th>x mm</th><th>y mm</th>'
        '<th>z mm</th><th>U, k=2, mm</th><th class="text">label</th>'
        '<th class="text">remarks</th></tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table>"
    )
