"""Guided checks, or without one the coverage of the joints."""

from collections.abc import Callable
from functools import partial

from nicegui import ui

from traverse.client.display.arm_state import ArmSight
from traverse.client.display.follower import Follower
from traverse.client.display.guided_check import CheckDesk, GuidedCheck
from traverse.client.page.controls import Dialogs
from traverse.client.page.health_tables import coverage_bars
from traverse.client.page.presses import Presses

CHECKS = (("Single point", "articulation", 10), ("Test sphere", "sphere", 9))
ANSWERS = (
    ("Another place: leave it out", GuidedCheck.leave_out),
    ("The others were wrong: begin with it", GuidedCheck.begin_with_it),
    ("The right one: count it", GuidedCheck.count_in),
)
LIMIT, DIAMETER = "Limit in mm", "Sphere's certified diameter in mm"


class CheckPanel:
    """Progress and results of a check.

    Created where it is displayed.

    Args:
        follower: of the arm; sets the label of the check's points.
    """

    def __init__(
        self, follower: Follower, desk: CheckDesk, dialogs: Dialogs, presses: Presses
    ) -> None:
        self._follower = follower
        self._desk = desk
        self._dialogs = dialogs
        with ui.element("section").classes("panel") as panel:
            panel.props('tabindex="0" aria-label="Guided checks"')
            with ui.element("div").classes("bar"):
                ui.html("<h2>Guided checks</h2>", sanitize=False)
                ui.space()
                for name, kind, n_touches in CHECKS:
                    begin = presses.guard(partial(self._begin, kind, n_touches))
                    ui.button(name, on_click=begin, color=None).props("outline dense")
                self._limit = ui.button("Limit", on_click=self._set_limit, color=None)
                self._limit.props("outline dense")
                end = presses.guard(self._end)
                self._close = ui.button("Close", on_click=end, color=None)
                self._close.props("flat dense")
            self._verdict = ui.label().classes("verdict")
            self._instruction = ui.label().classes("instruction")
            with ui.element("div").classes("bar") as self._answers:
                for name, act in ANSWERS:
                    answer = presses.guard(partial(self._answer, act))
                    ui.button(name, on_click=answer, color=None).props("outline dense")
            self._results = ui.html("", sanitize=False)
            with ui.element("div") as self._coverage:
                self._title = ui.html("", sanitize=False)
                self._bars = ui.html("", sanitize=False)
        self.show()

    def show_coverage(self, sight: ArmSight) -> None:
        old = sight.is_stale
        self._coverage.classes("old" if old else "", remove="old")
        when = ": out of date" if old and sight.live else ""
        self._title.set_content(f"<h2>Where the joints have been{when}</h2>")
        self._bars.set_content(coverage_bars(sight))

    def show(self) -> None:
        check = self._desk.check
        self._close.set_visibility(check is not None)
        self._limit.set_visibility(check is not None)
        self._coverage.set_visibility(check is None)
        self._verdict.set_visibility(check is not None)
        self._answers.set_visibility(check is not None and check.suspect is not None)
        self._instruction.set_text("" if check is None else check.instruction)
        rows = [] if check is None else check.results
        if check is not None:
            limit = "none" if check.limit_mm is None else f"{check.limit_mm:g} mm"
            self._limit.set_text(f"Limit: {limit}")
            level, words = check.verdict
            self._verdict.set_text(words)
            self._verdict.classes(level, remove="good busy warning bad")
        self._results.set_content(
            '<table class="plain wrap"><tbody>'
            + "".join(
                f'<tr><td class="text">{name}</td><td><b>{value}</b></td>'
                f'<td class="text"><small>{reason}</small></td></tr>'
                for name, value, reason in rows
            )
            + "</tbody></table>"
        )

    async def _begin(self, kind: str, n_touches: int) -> None:
        self._desk.begin(kind, n_touches)
        self.show()
        await self._follower.do(lambda arm: arm.label("check", kind))

    def _answer(self, act: Callable[[GuidedCheck], None]) -> None:
        self._desk.answer(act)
        self.show()

    async def _set_limit(self) -> None:
        check = self._desk.check
        if check is None:
            return
        fields = {LIMIT: "" if check.limit_mm is None else f"{check.limit_mm:g}"}
        quantity = "of the largest deviation from the mean"
        if check.kind == "sphere":
            fields[DIAMETER] = (
                "" if check.diameter_mm is None else f"{check.diameter_mm:g}"
            )
            quantity = "of form and error of size"
        action, values = await self._dialogs.ask(
            f"Which limit {quantity}?",
            ("Set",),
            fields,
            "The arm's certificate or its maker's data sheet says it. Empty: none, "
            "and then there is no verdict.",
        )
        if not action:
            return
        numbers: list[float | None] = []
        for value in (values[LIMIT], values.get(DIAMETER, "")):
            try:
                number = float(value.replace(",", ".")) if value else None
            except ValueError:
                number = -1.0
            if number is not None and not 0.0 < number < 1e6:
                self._follower.sight.refuse(
                    f"{value} is no length", "write a number of millimetres above 0"
                )
                return
            numbers.append(number)
        limit_mm, diameter_mm = numbers
        is_sphere = check.kind == "sphere"
        self._desk.set_limits(
            limit_mm, diameter_mm if is_sphere else self._desk.diameter_mm
        )
        self.show()

    async def _end(self) -> None:
        self._desk.check = None
        self.show()
        label = self._desk.label_before
        await self._follower.do(lambda arm: arm.label(label.artefact, label.feature))
