"""The page of `traverse setup`: its sections, from devices to joints."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from html import escape
from pathlib import Path

from nicegui import ui
from pydantic import BaseModel

from traverse.broker.credentials import CredentialsError
from traverse.cli.setup.arm_section import ArmChoice
from traverse.cli.setup.device_section import NEW_ID, DeviceList
from traverse.cli.setup.draft import Draft
from traverse.cli.setup.form import Form, button
from traverse.cli.setup.joints_panel import JointsPanel
from traverse.cli.setup.settings import settings_of
from traverse.client.errors import BrokerUnreachableError
from traverse.client.mqtt.subscription import find_arms
from traverse.client.page import serving as page_serving
from traverse.daemon.config import schema
from traverse.daemon.inputs import address_of
from traverse.strict_toml.problems import FileError, system_reason

STYLE = Path(page_serving.__file__).with_name("page.css")
ANSWER_S = 2.0  # of a broker
RECONNECT_S = 10.0
TABLES: dict[str, type[BaseModel]] = {
    "capture": schema.CaptureSection,
    "scan": schema.ScanSection,
    "quality": schema.QualitySection,
    "assembly": schema.AssemblySection,
    "uncertainty": schema.UncertaintySection,
    "recording": schema.RecordingSection,
    "outbox": schema.OutboxSection,
    "health": schema.HealthSection,
    "metrics": schema.MetricsSection,
}
"""Tables of the configuration whose keys are numbers, choices and short texts."""


def serve_setup(draft: Draft, serving: page_serving.Serving) -> None:
    @ui.page("/", title="Set-up - Traverse", reconnect_timeout=RECONNECT_S)
    def page() -> None:
        SetupPage(draft)

    page_serving.serve_pages(serving)


class SetupPage:
    """Builds the page for one browser; all share the draft."""

    def __init__(self, draft: Draft) -> None:
        self._draft = draft
        ui.add_css(STYLE)
        ui.dark_mode(value=None)
        with ui.element("div").classes("setup-page"):
            ui.html(f"<h1>Set-up: {escape(str(draft.path))}</h1>", sanitize=False)
            self._notice = ui.label("").classes("notice").props('role="status"')
            with _section("1. Devices"):
                devices = DeviceList(draft, self._changed)
            with _section("2. Arm file"):
                arm = ArmChoice(draft, self._changed, self._say)
            with _section("3. Buttons and switching probes"):
                self._inputs()
            with _section("4. Broker"):
                self._broker()
            with _section("5. Settings"):
                self._settings()
            with _section("6. Check and write"):
                self._file()
            with _section("7. Joints"):
                JointsPanel(draft, self._say)
        self._lists = (devices.show, arm.show, self._inputs, self._file)

    def _say(self, text: str, *, is_bad: bool = False) -> None:
        self._notice.set_text(text)
        self._notice.classes("bad" if is_bad else "", remove="bad")

    def _changed(self, text: str) -> None:
        self._say(f"{text}. Not written yet: see 6.")
        for part in self._lists:
            part.refresh()

    # -- inputs -----------------------------------------------------------------

    @ui.refreshable_method
    def _inputs(self) -> None:
        inputs = list(self._draft.values.get("capture", {}).get("inputs", []))

        def store(text: str) -> None:
            self._draft.set_table("capture", {"inputs": inputs or None})
            self._changed(text)

        def remove(index: int) -> None:
            removed = inputs.pop(index)
            store(f"{removed.get('source')} is removed")

        def add() -> None:
            values = form.values()
            table = {key: value for key, value in values.items() if value is not None}
            inputs.append(table)
            store(f"{table.get('source')} is added")

        for index, table in enumerate(inputs):
            with ui.element("div").classes("bar"):
                words = (f"{key} {value}" for key, value in table.items())
                ui.label(", ".join(words))
                button("Remove", partial(remove, index))
        first = next((str(device.get("id")) for device in self._draft.devices), NEW_ID)
        with ui.element("div").classes("fields"):
            present = {"source": f"{first}/{len(inputs)}", "trigger": "button"}
            form = Form(settings_of(schema.InputSection), present)
        button("Add", add)

    # -- broker and settings ----------------------------------------------------

    @ui.refreshable_method
    def _broker(self) -> None:
        with ui.element("div").classes("fields"):
            present = self._draft.values.get("broker", {"host": "localhost"})
            form = Form(settings_of(schema.BrokerSection), present)

        def take() -> None:
            self._draft.set_table("broker", form.values())
            self._changed("The broker is set")

        async def test() -> None:
            values = {k: v for k, v in form.values().items() if v is not None}
            try:
                section = schema.BrokerSection.model_validate(values)
                address = address_of(section, self._draft.path.parent)
                arms = await find_arms(address, ANSWER_S)
            except (BrokerUnreachableError, CredentialsError, ValueError) as error:
                self._say(str(error), is_bad=True)
                return
            known = f"; arms there: {', '.join(arms)}" if arms else ""
            self._say(f"The broker {address} answers{known}.")

        with ui.element("div").classes("bar"):
            button("Set", take)
            button("Try it", test)

    @ui.refreshable_method
    def _settings(self) -> None:
        for name, model in TABLES.items():
            with ui.expansion(name):
                with ui.element("div").classes("fields"):
                    present = self._draft.values.get(name, {})
                    form = Form(settings_of(model), present)

                def take(name: str = name, form: Form = form) -> None:
                    self._draft.set_table(name, form.values())
                    self._changed(f"[{name}] is set")

                button("Set", take)

    # -- check and write ----------------------------------------------------------

    @ui.refreshable_method
    def _file(self) -> None:
        problems = self._problems()
        for problem in problems:
            ui.label(problem).classes("problem")
        if not problems:
            ui.label("No mistakes.").classes("state good")
        if "broker" not in self._draft.values:
            ui.label(
                "Without a broker: start it with `traverse run --embedded-broker`."
            ).classes("dim")
        text = ui.textarea("The file as it would be written", value=self._draft.text)
        text.props("outlined autogrow").classes("file-text")

        def take() -> None:
            try:
                self._draft.replace_text(str(text.value or ""))
            except FileError as error:
                self._say(str(error), is_bad=True)
                return
            self._changed("The text is taken")
            self._broker.refresh()
            self._settings.refresh()

        with ui.element("div").classes("bar"):
            button("Take the text", take)
            write = button("Write", self._write)
            write.set_enabled(not problems)

    def _problems(self) -> list[str]:
        try:
            return self._draft.problems()
        except OSError as error:
            return [f"{self._draft.path}: {system_reason(error)}"]

    def _write(self) -> None:
        if problems := self._problems():
            self._say(problems[0], is_bad=True)
            return
        try:
            previous = self._draft.write()
        except OSError as error:
            self._say(f"{self._draft.path}: {system_reason(error)}", is_bad=True)
            return
        kept = f"; the file before is {previous.name}" if previous else ""
        self._say(
            f"{self._draft.path} is written{kept}. Start the daemon with `traverse run "
            f"{self._draft.path}`, or restart its service."
        )


@contextmanager
def _section(title: str) -> Iterator[None]:
    with ui.element("section").classes("panel").props(f'aria-label="{title}"'):
        ui.html(f"<h2>{title}</h2>", sanitize=False)
        yield
