"""Fields of a form for the keys of a table, and buttons."""

from collections.abc import Callable, Mapping
from html import escape
from typing import Any, Protocol

from nicegui import ui

from traverse.cli.setup.settings import Setting


class Say(Protocol):
    """Shows a sentence to the operator."""

    def __call__(self, text: str, *, is_bad: bool = False) -> None: ...


class Form:
    """Fields for the keys of a table, those without a default first.

    Args:
        settings: Its keys.
        values: Of the keys that are set.
    """

    def __init__(self, settings: list[Setting], values: Mapping[str, object]) -> None:
        self._fields = {
            setting: self._field(setting, values.get(setting.key))
            for setting in settings
        }

    @staticmethod
    def _field(setting: Setting, value: object) -> ui.input | ui.select:
        text = setting.text_of(value)
        if setting.choices:
            choices = {"": "", **{choice: choice for choice in setting.choices}}
            control: ui.input | ui.select = ui.select(
                choices, label=setting.key, value=text if text in choices else ""
            )
        else:
            control = ui.input(setting.key, value=text)
        if setting.hint:
            control.props(f'hint="{escape(setting.hint)}"')
        return control

    def set(self, key: str, text: str) -> None:
        for setting, entry in self._fields.items():
            if setting.key == key:
                entry.set_value(text)

    def values(self) -> dict[str, object]:
        return {
            setting.key: setting.value_of(str(entry.value or ""))
            for setting, entry in self._fields.items()
        }


def button(text: str, act: Callable[[], Any]) -> ui.button:
    control = ui.button(text, on_click=act, color=None)
    return control.props("outline dense no-caps")
