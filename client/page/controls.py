"""Soft buttons, and keys that do the same."""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from nicegui import ui
from nicegui.events import KeyEventArguments

Act = Callable[[], Awaitable[None] | None]


@dataclass(frozen=True, slots=True)
class Soft:
    """One soft button.

    Attributes:
        key: as the browser names it; shown in capitals, " " as Space.
    """

    name: str
    key: str
    act: Act
    kind: str = ""


class Controls:
    """A row of large buttons.

    Args:
        buttons: of the row.
        keys: more keys, without buttons.
    """

    def __init__(self, buttons: list[Soft], keys: dict[str, Act]) -> None:
        self._acts: dict[str, Act] = dict(keys)
        self._buttons: dict[str, ui.button] = {}
        with ui.element("section").classes("controls") as row:
            row.props('aria-label="Commands to the arm"')
            for soft in buttons:
                self._acts[soft.key] = soft.act
                shown = "Space" if soft.key == " " else soft.key.upper()
                with ui.button(on_click=soft.act, color=None) as button:
                    button.props("unelevated")
                    button.classes(soft.kind)
                    button.props(f'aria-keyshortcuts="{shown}"')
                    with ui.element("div"):
                        label = ui.label(soft.name)
                        ui.label(f"key {shown}").classes("key")
                self._buttons[soft.key] = button
                button.traverse_label = label  # type: ignore[attr-defined]  # kept with it
        # Space on a button presses that button; letters mean the same everywhere.
        ui.keyboard(self._space, repeating=False)
        ui.keyboard(
            self._letter, repeating=False, ignore=["input", "select", "textarea"]
        )
        # A button clicked by hand, or what is in it, would else keep the focus, and
        # Space its meaning.
        ui.add_body_html(
            "<script>addEventListener('pointerup', () => setTimeout(() => {"
            " const focused = document.activeElement;"
            " if (focused?.closest('button')) focused.blur() }))</script>"
        )

    def name(self, key: str, name: str, *, is_on: bool) -> None:
        """Update what a button does, and whether it is active."""
        button = self._buttons[key]
        button.traverse_label.set_text(name)  # type: ignore[attr-defined]  # as above
        button.classes(add="on" if is_on else "", remove="" if is_on else "on")

    async def _space(self, event: KeyEventArguments) -> None:
        if str(event.key) == " ":
            await self._pressed(event)

    async def _letter(self, event: KeyEventArguments) -> None:
        if str(event.key) != " ":
            await self._pressed(event)

    async def _pressed(self, event: KeyEventArguments) -> None:
        modifiers = event.modifiers
        if (
            not event.action.keydown
            or modifiers.ctrl
            or modifiers.alt
            or modifiers.meta
        ):
            return
        act = self._acts.get(str(event.key).lower())
        if act is not None:
            waiting = act()
            if waiting is not None:
                await waiting
