"""Questions to the operator."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from nicegui import ui


@dataclass(slots=True)
class Dialogs:
    """Asks one question at a time; keys belong to it as long as it is open."""

    is_open: bool = field(default=False, init=False)

    async def ask(
        self,
        title: str,
        actions: Sequence[str],
        fields: Mapping[str, str] | None = None,
        more: str = "",
    ) -> tuple[str, dict[str, str]]:
        """Ask.

        Args:
            title: the question.
            actions: the answers besides "Cancel"; the first is the one of Enter.
            fields: what is to be filled in, with what is there.
            more: further text above the buttons.

        Returns:
            The action, empty where there was none, and what was filled in.
        """
        inputs: dict[str, ui.input] = {}
        with ui.dialog() as dialog, ui.card().classes("question"):
            ui.label(title).classes("title")
            if more:
                ui.label(more)
            for name, value in (fields or {}).items():
                first = "autofocus" if not inputs else ""
                inputs[name] = ui.input(name, value=value).props(first)
                inputs[name].on("keydown.enter", lambda: dialog.submit(actions[0]))
            with ui.element("div").classes("bar"):
                for action in actions:
                    button = ui.button(
                        action, on_click=lambda a=action: dialog.submit(a), color=None
                    )
                    if not inputs and action == actions[0]:
                        button.props("autofocus")
                ui.button("Cancel", on_click=dialog.close, color=None)
        self.is_open = True
        try:
            answer = await dialog
        finally:
            self.is_open = False
            dialog.delete()
        return answer or "", {
            name: (i.value or "").strip() for name, i in inputs.items()
        }
