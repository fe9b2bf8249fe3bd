"""The sentence at the top with the arm's condition, and the switches beside it."""

from collections.abc import Callable

from nicegui import ui

from traverse.client.display.condition import Verdict


class Banner:
    """Built where it is made.

    Args:
        arm: its name.
        mute: called by the switch of the sound.
        turn_light: called by that of the light.
    """

    def __init__(
        self, arm: str, mute: Callable[[], None], turn_light: Callable[[], None]
    ) -> None:
        with ui.element("header").classes("panel banner good") as self._banner:
            ui.label(arm).classes("arm")
            with ui.element("div").classes("said").props('role="alert"'):
                self._sentence = ui.label()
                self._remedy = ui.label().classes("remedy")
            self._sound = ui.button("Sound on", on_click=mute, color=None)
            self._sound.props('flat dense aria-keyshortcuts="M"')
            self._light = ui.button("Light", on_click=turn_light, color=None)
            self._light.props('flat dense aria-keyshortcuts="D"')

    def show(self, said: Verdict) -> None:
        """Show the arm's condition."""
        others = {"good", "warning", "bad"} - {said.level}
        self._banner.classes(add=said.level, remove=" ".join(others))
        more = f" (and {said.others} more)" if said.others else ""
        self._sentence.set_text(said.sentence + more)
        self._remedy.set_text(said.remedy)

    def tell_refused(self, text: str) -> None:
        """Show for some time that something was refused, and why."""
        with self._banner:
            ui.notify(text, type="negative", timeout=8000, position="top")

    def turn_sound(self) -> bool:
        """Name the switch of the sound anew; whether there is none now."""
        is_muted = bool(self._sound.text == "Sound on")
        self._sound.set_text("Sound off" if is_muted else "Sound on")
        return is_muted

    def name_light(self, *, is_dark: bool) -> None:
        """Name the switch of the light by what it would do."""
        self._light.set_text("Light" if is_dark else "Dark")
