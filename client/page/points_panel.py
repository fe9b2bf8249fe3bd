"""The list of points, its title, and the buttons that label and save them."""

from collections.abc import Awaitable, Callable

from nicegui import ui

from traverse.client.page.readout import point_rows
from traverse.protocol.messages import Point

SHOWN_POINTS = 60
FILES = (("CSV", "csv"), ("JSON", "jsonl"), ("PLY", "ply"))


class PointsPanel:
    """Built where it is made.

    Args:
        label: called to label the next points.
        saving: gives what saves the points as a kind of file.
    """

    def __init__(
        self,
        label: Callable[[], Awaitable[None]],
        saving: Callable[[str], Callable[[], None]],
    ) -> None:
        with ui.element("section").classes("panel"):
            with ui.element("div").classes("bar"):
                self._title = ui.html("<h2>Points</h2>", sanitize=False)
                ui.space()
                button = ui.button("Label (L)", on_click=label, color=None)
                button.props("flat dense")
                for name, kind in FILES:
                    save = ui.button(name, on_click=saving(kind), color=None)
                    save.props(f'flat dense aria-label="Save points as {name}"')
            self._rows = ui.html(point_rows([], None), sanitize=False)

    def show(self, points: list[Point], n_lost: int, newest: str | None) -> None:
        """Show the last of them, one of them as new."""
        self._rows.set_content(point_rows(points[-SHOWN_POINTS:], newest))
        told = f", {n_lost} lost" if n_lost else ""
        self._title.set_content(f"<h2>Points: {len(points)}{told}</h2>")
