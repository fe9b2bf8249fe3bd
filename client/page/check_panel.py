"""Guided checks; while there is none, where the joints have been."""

from collections.abc import Callable

from nicegui import ui

from traverse.client.display.arm_state import ArmSight
from traverse.client.display.guided_check import GuidedCheck
from traverse.client.page.health_tables import coverage_bars
from traverse.protocol.messages import Point

CHECKS = (("Single point", "articulation", 10), ("Sphere", "sphere", 9))


class CheckPanel:
    """Built where it is made."""

    def __init__(self) -> None:
        self._check: GuidedCheck | None = None
        with ui.element("section").classes("panel"):
            with ui.element("div").classes("bar"):
                ui.html("<h2>Guided checks</h2>", sanitize=False)
                ui.space()
                for name, kind, wanted in CHECKS:
                    begin = self._beginning(kind, wanted)
                    button = ui.button(name, on_click=begin, color=None)
                    button.props("outline dense")
                self._close = ui.button("Close", on_click=self._end, color=None)
                self._close.props("flat dense").set_visibility(False)
            self._instruction = ui.label().classes("instruction")
            self._results = ui.html("", sanitize=False)
            with ui.element("div") as self._coverage:
                ui.html("<h2>Where the joints have been</h2>", sanitize=False)
                self._bars = ui.html("", sanitize=False)

    def take(self, point: Point) -> None:
        """A point or a retraction was received."""
        if self._check is not None:
            if point.retracts is None:
                self._check.take(point)
            else:
                self._check.undo(point.retracts)
        self._show()

    def show_coverage(self, sight: ArmSight) -> None:
        """Show where the joints have been."""
        self._bars.set_content(coverage_bars(sight))

    def _show(self) -> None:
        check = self._check
        self._close.set_visibility(check is not None)
        self._coverage.set_visibility(check is None)
        self._instruction.set_text("" if check is None else check.instruction)
        rows = [] if check is None else check.results
        self._results.set_content(
            '<table class="plain wrap"><tbody>'
            + "".join(
                f'<tr><td class="text">{name}</td><td><b>{value}</b></td>'
                f'<td class="text"><small>{told}</small></td></tr>'
                for name, value, told in rows
            )
            + "</tbody></table>"
        )

    def _beginning(self, kind: str, wanted: int) -> Callable[[], None]:
        def begin() -> None:
            self._check = GuidedCheck(kind, wanted)
            self._show()

        return begin

    def _end(self) -> None:
        self._check = None
        self._show()
