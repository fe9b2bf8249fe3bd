"""Soft buttons, keys that do the same, and questions to the operator."""

from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from nicegui import ui
from nicegui.events import KeyEventArguments

from traverse.client.page.presses import Presses

Act = Callable[[], Awaitable[None] | None]


@dataclass(frozen=True, slots=True)
class Soft:
    """One soft button.

    Attributes:
        key: as the browser names it; shown in capitals, " " as Space.
        needs_pose: it measures, so that a pose must be there.
    """

    name: str
    key: str
    act: Act
    kind: str = ""
    needs_pose: bool = False


class Controls:
    """A row of large buttons.

    Args:
        is_blocked: whether keys belong to a dialog.
    """

    def __init__(
        self,
        buttons: list[Soft],
        keys: dict[str, Act],
        is_blocked: Callable[[], bool],
        presses: Presses,
    ) -> None:
        self._acts: dict[str, Act] = dict(keys)
        self._is_blocked = is_blocked
        self._buttons: dict[str, tuple[Soft, ui.button, ui.label]] = {}
        with ui.element("section").classes("controls") as row:
            row.props('aria-label="Commands to the arm"')
            for soft in buttons:
                self._acts[soft.key] = soft.act
                shown = "Space" if soft.key == " " else soft.key.upper()
                act = presses.guard(soft.act)
                with ui.button(on_click=act, color=None) as button:
                    button.classes(soft.kind)
                    button.props(f'unelevated aria-keyshortcuts="{shown}"')
                    with ui.element("div"):
                        label = ui.label(soft.name)
                        ui.label(f"key {shown}").classes("key")
                self._buttons[soft.key] = (soft, button, label)
        # Space on a button presses that button; letters mean the same everywhere.
        ui.keyboard(presses.guard(self._space), repeating=False)
        ui.keyboard(
            presses.guard(self._letter),
            repeating=False,
            ignore=["input", "select", "textarea"],
        )
        # A button clicked by hand, or what is in it, would else keep the focus, and
        # Space its meaning.
        ui.add_body_html(
            "<script>addEventListener('pointerup', () => setTimeout(() => {"
            " const focused = document.activeElement;"
            " if (focused?.closest('button')) focused.blur() }))</script>"
        )

    def add_key(self, key: str, act: Act) -> None:
        self._acts[key] = act

    def name(self, key: str, name: str, *, is_on: bool = False) -> None:
        _, button, label = self._buttons[key]
        label.set_text(name)
        button.classes("on" if is_on else "", remove="on")

    def allow(self, is_possible: Callable[[Soft], bool]) -> None:
        """Disable impossible buttons; a key shows the reason."""
        for soft, button, _ in self._buttons.values():
            button.set_enabled(is_possible(soft))

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
            or self._is_blocked()
        ):
            return
        act = self._acts.get(str(event.key).lower())
        if act is not None:
            waiting = act()
            if waiting is not None:
                await waiting


@dataclass(slots=True)
class Dialogs:
    """Asks one question at a time; keys belong to it while it is open."""

    presses: Presses
    is_open: bool = field(default=False, init=False)

    async def ask(
        self,
        title: str,
        actions: Sequence[str],
        fields: Mapping[str, str] | None = None,
        details: str = "",
    ) -> tuple[str, dict[str, str]]:
        """Ask.

        Args:
            title: the question.
            actions: the answers besides "Cancel"; the first is that of Enter.
            fields: to be filled in, with present values.
            details: further lines above the buttons.

        Returns:
            The action, empty for none, and the fields.
        """
        inputs: dict[str, ui.input] = {}
        dialog = ui.dialog()
        dialog.props["aria-label"] = title
        submit = self.presses.guard(dialog.submit)
        with dialog, ui.card().classes("question"):
            ui.label(title).classes("title")
            for line in details.splitlines():
                ui.label(line)
            for name, value in (fields or {}).items():
                first = "autofocus" if not inputs else ""
                inputs[name] = ui.input(name, value=value).props(first)
                inputs[name].on("keydown.enter", partial(submit, actions[0]))
            with ui.element("div").classes("bar"):
                for action in actions:
                    act = partial(submit, action)
                    button = ui.button(action, on_click=act, color=None)
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
