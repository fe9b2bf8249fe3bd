"""The state of the arm, large, at the top; beneath it the last event."""

import time
from collections.abc import Callable
from html import escape

from nicegui import ui

from traverse.client.display.condition import Level, Verdict

# Told apart by their shape, too: a disc, bars that move, a triangle, an octagon.
ICONS: dict[Level, str] = {
    "good": '<circle cx="12" cy="12" r="10"/><path class="on" d="M7 12l4 4 7-8"/>',
    "busy": '<path d="M2 9h4v6H2zM10 5h4v14h-4zM18 1h4v22h-4z"/>',
    "warning": '<path d="M12 2l11 20H1z"/><path class="on" d="M12 9v6M12 18v2"/>',
    "bad": '<path d="M8 1h8l7 7v8l-7 7H8l-7-7V8z"/>'
    '<path class="on" d="M8 8l8 8M16 8l-8 8"/>',
}
SILENT = (
    '<span class="silent-word">Stale</span>'
    '<div role="alert"><b class="silent-for sentence">'
    "</b><br>What is shown is out of date, and nothing can be done here. Look whether "
    "the program `traverse page` runs, and at the network.</div>"
)
WORDS = {"refused": "Refused: ", "alarm": "Alarm: "}
KINDS = {"point", "doubt", "retraction", "refused", "alarm", "cleared"}


class Banner:
    """State and last event.

    Created where it is displayed.

    Args:
        mute: called by the switch of the sound.
        speak: called by the switch of speech.
        turn_digits: called by the switch of the view of digits alone.
        turn_light: called by the switch of the colours.
    """

    def __init__(
        self,
        arm: str,
        *,
        mute: Callable[[], None],
        speak: Callable[[], None],
        turn_digits: Callable[[], None],
        turn_light: Callable[[], None],
    ) -> None:
        self._is_muted = self._speaks = False
        with ui.element("header").classes("panel banner") as self._banner:
            self._icon = ui.html("", sanitize=False).classes("icon")
            with ui.element("div").classes("said"):
                self._word = ui.label().classes("word").props('role="alert"')
                with ui.element("div"):
                    self._sentence = ui.label().classes("sentence")
                    self._remedy = ui.label().classes("remedy")
            # Shown by the browser when the server is silent, see watch.js.
            ui.html(SILENT, sanitize=False).classes("silent-banner")
            with ui.element("div").classes("switches"):
                name = ui.html(f"<h1>{escape(arm)}</h1>", sanitize=False)
                name.classes("arm").props('translate="no"')
                self._sound = ui.button("Mute", on_click=mute, color=None)
                self._sound.props('flat dense aria-keyshortcuts="M"')
                self._speech = ui.button("Speak", on_click=speak, color=None)
                self._speech.props('flat dense aria-keyshortcuts="V"')
                digits = ui.button("Digits", on_click=turn_digits, color=None)
                digits.props('flat dense aria-keyshortcuts="G"')
                self._light = ui.button(on_click=turn_light, color=None)
                self._light.props('flat dense aria-keyshortcuts="D"')
        self.name_light(is_dark=True)
        with ui.element("div").classes("message"):
            self._time = ui.label().classes("at")
            self._message = ui.label().classes("notice")
            self._message.props('role="status" aria-live="polite"')
            notice = ui.html(
                '<span class="press-outcome" role="alert"></span>', sanitize=False
            )
            notice.classes("press")

    def show(self, verdict: Verdict) -> None:
        self._banner.classes(verdict.level, remove=" ".join(ICONS))
        self._icon.set_content(
            f'<svg viewBox="0 0 24 24" aria-hidden="true">{ICONS[verdict.level]}</svg>'
        )
        self._word.set_text(verdict.word)
        self._sentence.set_text(verdict.text)
        self._remedy.set_text(verdict.remedy)

    def tell(self, kind: str, text: str) -> None:
        self._message.classes(kind, remove=" ".join(KINDS))
        self._time.set_text(time.strftime("%H:%M:%S"))
        self._message.set_text(f"{WORDS.get(kind, '')}{text}")

    def turn_sound(self) -> bool:
        """Update the switch of the sound; return whether it is off."""
        self._is_muted = not self._is_muted
        self._sound.set_text("Unmute" if self._is_muted else "Mute")
        return self._is_muted

    def turn_speech(self) -> bool:
        """Update the switch of speech; return whether it is on."""
        self._speaks = not self._speaks
        self._speech.set_text("Silent" if self._speaks else "Speak")
        return self._speaks

    def name_light(self, *, is_dark: bool) -> None:
        """Label the switch of the colours by its action."""
        self._light.set_text("Light colours" if is_dark else "Dark colours")
