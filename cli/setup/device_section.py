"""The devices of a configuration on the page, and the ports of this computer."""

from collections.abc import Callable
from functools import partial

from nicegui import ui

from traverse.cli.setup.draft import Draft
from traverse.cli.setup.form import Form, button
from traverse.cli.setup.ports import can_interfaces, serial_ports
from traverse.cli.setup.settings import settings_of
from traverse.daemon.config.devices import section_class
from traverse.drivers.base.registry import driver_names

NEW_ID = "base"


class DeviceList:
    """Lists devices and ports; asks for driver, id and options.

    Args:
        changed: Called after a change of the draft, with a sentence about it.
    """

    def __init__(self, draft: Draft, changed: Callable[[str], None]) -> None:
        self._draft = draft
        self._changed = changed
        self.show()

    @ui.refreshable_method
    def show(self) -> None:
        for index, table in enumerate(self._draft.devices):
            with ui.element("div").classes("bar"):
                where = table.get("port") or table.get("channel") or ""
                name, driver = table.get("id", "?"), table.get("driver", "?")
                ui.label(f"{name}: {driver} {where}")
                button("Change", partial(self._ask_device, index))
                button("Remove", partial(self._remove_device, index))
        ui.label("Ports of this computer:").classes("dim")
        ports = [str(path) for path in serial_ports()]
        for port in ports:
            with ui.element("div").classes("bar"):
                ui.label(port)
                button("Use", partial(self._ask_device, None, port))
        for name in can_interfaces():
            with ui.element("div").classes("bar"):
                ui.label(f"CAN interface {name}")
                button("Use", partial(self._ask_device, None, name, "canopen"))
        if not ports:
            ui.label("No serial port: plug the device in, and press Look again.")
        with ui.element("div").classes("bar"):
            button("Look again", self.show.refresh)
            button("Another port", partial(self._ask_device, None))

    def _remove_device(self, index: int) -> None:
        tables = self._draft.devices
        removed = tables.pop(index)
        self._draft.set_devices(tables)
        self._changed(f"{removed.get('id')} is removed")

    def _ask_device(
        self, index: int | None, port: str = "", driver: str = "latch-board"
    ) -> None:
        tables = self._draft.devices
        present = dict(tables[index]) if index is not None else {"driver": driver}
        names = {str(table.get("id")) for table in tables}
        number = len(tables)
        fresh = NEW_ID if NEW_ID not in names else f"device-{number + 1}"
        form: list[Form] = []
        with ui.dialog(value=True) as dialog, ui.card().classes("question wide"):
            ui.label("Which device?").classes("title")
            chosen = ui.select(
                list(driver_names()), label="driver", value=present.get("driver")
            )
            identity = ui.input("id", value=str(present.get("id", fresh)))

            @ui.refreshable
            def options() -> None:
                settings = [
                    setting
                    for setting in settings_of(section_class(str(chosen.value)))
                    if setting.key not in ("id", "driver")
                ]
                form[:] = [Form(settings, present)]
                for key in ("port", "ports", "channel"):
                    if port:
                        form[0].set(key, port)

            with ui.element("div").classes("fields"):
                options()
            chosen.on_value_change(options.refresh)

            def take() -> None:
                values = {
                    "id": identity.value,
                    "driver": chosen.value,
                    **form[0].values(),
                }
                # Tables, which the form does not show, stay.
                nested = {
                    k: v for k, v in present.items() if isinstance(v, list | dict)
                }
                table = {**nested, **values}
                if index is None:
                    tables.append(table)
                else:
                    tables[index] = table
                self._draft.set_devices(tables)
                dialog.close()
                self._changed(f"{identity.value} is set")

            with ui.element("div").classes("bar"):
                button("Set", take)
                button("Cancel", dialog.close)
