"""The list of points with its title and buttons."""

from collections.abc import Callable
from functools import partial
from html import escape

from nicegui import ui

from traverse.client.display.arm_state import MAX_POINTS, ArmSight
from traverse.client.page.readout import Choices, point_rows

SHOWN_POINTS = 60
FILES = (("CSV", "csv"), ("JSON", "jsonl"), ("PLY", "ply"))


class PointsPanel:
    """Created where it is displayed.

    Args:
        save: saves points as a kind of file.
        show_session: called with the session to be shown; None: the arm's.
    """

    def __init__(
        self,
        choices: Choices,
        save: Callable[[str], None],
        show_session: Callable[[str | None], None],
    ) -> None:
        self._choices = choices
        self._earlier: str | None = None
        with ui.element("section").classes("panel points") as self._panel:
            self._panel.props('tabindex="0" aria-label="Points"')
            with ui.element("div").classes("bar"):
                self._title = ui.html("", sanitize=False)
                ui.space()
                self._back = ui.button(
                    "Earlier session",
                    on_click=lambda: show_session(self._earlier),
                    color=None,
                ).props("outline dense")
                self._forth = ui.button(
                    "Back to now", on_click=lambda: show_session(None), color=None
                ).props("outline dense")
                for name, kind in FILES:
                    file = ui.button(name, on_click=partial(save, kind), color=None)
                    file.props(f'flat dense aria-label="Save points as {name}"')
            self._rows = ui.html("", sanitize=False)

    def show(self, sight: ArmSight, newest: str | None) -> None:
        points, system = list(sight.points.values()), self._choices.system(sight)
        self._rows.set_content(
            point_rows(
                points[-SHOWN_POINTS:],
                newest,
                system,
                self._choices.unit,
                sight.aligned_ns,
            )
        )
        losses = f", {sight.lost_points} lost" if sight.lost_points else ""
        most = ", the latest" if len(points) == MAX_POINTS else ""
        session_note = " of an earlier session" if sight.shown_session else ""
        where = escape(self._choices.system_words(sight))
        self._title.set_content(
            f"<h2>Points{session_note}: {len(points)}{most}{losses}, {where}</h2>"
        )
        self._earlier = sight.earlier_session
        self._back.set_visibility(self._earlier is not None)
        self._forth.set_visibility(sight.shown_session is not None)

    def show_age(self, sight: ArmSight) -> None:
        """Disable it if points may be missing here."""
        old = not sight.is_online
        self._panel.classes("old" if old else "", remove="old")
