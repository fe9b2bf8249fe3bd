"""The arm file of a configuration on the page: chosen, or made of a description."""

from collections.abc import Callable
from functools import partial

from nicegui import ui
from nicegui.events import UploadEventArguments

from traverse.cli.setup.arm_import import ABSOLUTE, FIELDS, INCREMENTAL, import_arm
from traverse.cli.setup.device_section import NEW_ID
from traverse.cli.setup.draft import Draft
from traverse.cli.setup.form import Say, button
from traverse.strict_toml.problems import system_reason

MOST_BYTES = 8_000_000  # of an upload


class ArmChoice:
    """Lists the arm files beside the configuration; makes one of an upload.

    Args:
        changed: Called after a change of the draft, with a sentence about it.
    """

    def __init__(self, draft: Draft, changed: Callable[[str], None], say: Say) -> None:
        self._draft = draft
        self._changed = changed
        self._say = say
        self._upload: tuple[str, bytes] | None = None
        self._build()

    def _build(self) -> None:
        self.show()
        with ui.expansion("Make one of a Denavit-Hartenberg table or a URDF"):
            # The uploader's own button is a link with an input in it.
            upload = ui.upload(
                auto_upload=True,
                max_file_size=MOST_BYTES,
                on_upload=self._uploaded,
                on_rejected=lambda: self._say(
                    f"The file is larger than {MOST_BYTES} bytes.", is_bad=True
                ),
            ).classes("hidden")
            button(
                "Choose a CSV, TOML or URDF file",
                partial(upload.run_method, "pickFiles"),
            )
            with ui.element("div").classes("fields"):
                texts = {
                    name: ui.input(name, value=text) for name, text in FIELDS.items()
                }
                convention = ui.select(
                    ["classic", "modified"],
                    label="Convention of a table",
                    clearable=True,
                )
                encoders = ui.select(
                    [ABSOLUTE, INCREMENTAL], label="Encoders", clearable=True
                )

            def make() -> None:
                if self._upload is None:
                    self._say("Choose a file first.", is_bad=True)
                    return
                device = next((str(d.get("id")) for d in self._draft.devices), NEW_ID)
                try:
                    file, remarks = import_arm(
                        self._draft.path.parent,
                        self._upload,
                        {name: str(entry.value) for name, entry in texts.items()},
                        convention=convention.value,
                        encoders=encoders.value,
                        device=device,
                    )
                except ValueError as error:
                    self._say(str(error), is_bad=True)
                    return
                except OSError as error:
                    self._say(system_reason(error), is_bad=True)
                    return
                self._draft.set_table("arm", {"file": file.name})
                self._changed("; ".join((f"{file} is made", *remarks)))

            button("Make the arm file", make)

    async def _uploaded(self, event: UploadEventArguments) -> None:
        self._upload = event.file.name, await event.file.read()
        self._say(f"{event.file.name} is here.")

    @ui.refreshable_method
    def show(self) -> None:
        files = self._draft.arm_files()
        if not files and not self._draft.arm_file:
            ui.label(f"No arm file in {self._draft.path.parent.resolve()}.")
        for name in sorted({*files, *filter(None, [self._draft.arm_file])}):
            with ui.element("div").classes("bar"):
                is_used = name == self._draft.arm_file
                ui.label(f"{name}{' (in use)' if is_used else ''}")
                if not is_used:
                    button("Use", partial(self._use_arm, name))

    def _use_arm(self, name: str) -> None:
        self._draft.set_table("arm", {"file": name})
        self._changed(f"{name} is used")
