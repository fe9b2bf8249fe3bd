"""Settings as buttons that name them: label, probe, alignment, display."""

from collections.abc import Awaitable, Callable
from functools import partial
from math import inf

from nicegui import ui

from traverse.client.display.arm_state import ArmSight
from traverse.client.display.condition import wanted_commands
from traverse.client.display.figures import INCH, MM, SYSTEMS
from traverse.client.display.follower import Follower
from traverse.client.display.nominal import Nominal
from traverse.client.page.controls import Dialogs
from traverse.client.page.language import choose_language
from traverse.client.page.presses import Presses
from traverse.client.page.readout import NAMES, Choices


class SetupBar:
    """Created where it is displayed.

    Args:
        choices: of display; changed here.
        changed: called when choices have changed.
    """

    def __init__(
        self,
        follower: Follower,
        choices: Choices,
        dialogs: Dialogs,
        presses: Presses,
        changed: Callable[[], None],
    ) -> None:
        self._follower = follower
        self._choices = choices
        self._dialogs = dialogs
        self._changed = changed
        with ui.element("section").classes("setup") as bar:
            bar.props('aria-label="Settings"')
            self._confirm = _button(
                presses.guard(self._confirm_reference), "unelevated"
            )
            self._confirm.classes("confirm")
            self._confirm.set_text("Confirm the arm's position")
            self._home = _button(presses.guard(self._set_home), "unelevated")
            self._home.classes("confirm")
            self._home.set_text("The arm is in its home posture")
            self._utc = _button(presses.guard(self._confirm_utc), "unelevated")
            self._utc.classes("confirm")
            self._utc.set_text("The computer's time is right")
            self._probe = _button(presses.guard(self._change_probe))
            self._label = _button(presses.guard(self.change_label))
            self._unit = _button(presses.guard(self._turn_unit))
            self._system = _button(presses.guard(self._turn_system))
            self._nominal = _button(presses.guard(self._change_nominal))
            self._spacing = _button(presses.guard(self._change_spacing))
            choose = partial(choose_language, dialogs, ui.context.client)
            _button(presses.guard(choose)).set_text("Language")

    def show(self, sight: ArmSight) -> None:
        choices, unit = self._choices, self._choices.unit
        needed_commands = wanted_commands(sight)
        self._confirm.set_visibility("reference" in needed_commands)
        self._home.set_visibility("home" in needed_commands)
        self._utc.set_visibility("utc" in needed_commands)
        radius = unit.with_name(sight.live.probe_radius_mm) if sight.live else "-"
        self._probe.set_text(f"Probe {sight.probe}".strip() + f": radius {radius}")
        label = sight.known_label
        words = None if label is None else (label.artefact, label.feature)
        named = "not known" if words is None else " ".join(filter(None, words))
        self._label.set_text(f"Label: {named or 'none'}")
        self._unit.set_text(f"Unit: {unit.name}")
        self._system.set_enabled(sight.is_aligned)
        self._system.set_text(f"Coordinates: {SYSTEMS[choices.system(sight)]}")
        tolerance = choices.nominal and unit.with_name(choices.nominal.tolerance_mm)
        self._nominal.set_text(f"Nominal: {f'± {tolerance}' if tolerance else 'none'}")
        spacing_mm = choices.scan_spacing_mm
        spaced = (
            "by time" if spacing_mm is None else f"each {unit.with_name(spacing_mm)}"
        )
        self._spacing.set_text(f"Scan: {spaced}")

    async def change_label(self) -> None:
        label = self._follower.sight.known_label
        action, values = await self._dialogs.ask(
            "What are the next points taken on?",
            ("Set", "Clear"),
            {
                "Artefact": (label and label.artefact) or "",
                "Feature": (label and label.feature) or "",
            },
        )
        if action:
            names = (values["Artefact"] or None, values["Feature"] or None)
            label_parts = names if action == "Set" else ()
            await self._follower.do(lambda arm: arm.label(*label_parts))

    async def _confirm_reference(self) -> None:
        causes = wanted_commands(self._follower.sight).get("reference", [])
        action, _ = await self._dialogs.ask(
            "Is the position that is shown right?",
            ("It is right",),
            details=" ".join(f"{cause}." for cause in causes)
            + " Bring the arm to its reference and touch a known point first: encoders "
            "may count from another place, or be others.",
        )
        if action:
            await self._follower.do(lambda arm: arm.confirm_reference())

    async def _confirm_utc(self) -> None:
        causes = wanted_commands(self._follower.sight).get("utc", [])
        action, _ = await self._dialogs.ask(
            "Is the UTC that the arm's computer shows right?",
            ("It is right",),
            details=" ".join(f"{cause}." for cause in causes)
            + " Compare it with a clock that you trust.",
        )
        if action:
            await self._follower.do(lambda arm: arm.confirm_reference(utc=True))

    async def _set_home(self) -> None:
        action, _ = await self._dialogs.ask(
            "Is the arm in its home posture, and still?",
            ("It is in its home posture",),
            details="Counts of incremental encoders are set to [home] of the arm file.",
        )
        if action:
            await self._follower.do(lambda arm: arm.home())

    async def _change_probe(self) -> None:
        sight, field = self._follower.sight, "Name in the probe library"
        names = (sight.status and sight.status.probes) or ()
        # The first one is that of Enter: no change.
        actions = sorted(names, key=lambda name: name != sight.probe) or ["Set"]
        fields = {} if names else {field: sight.probe}
        chosen, values = await self._dialogs.ask(
            "Which probe is on the arm?", actions, fields
        )
        name = chosen if names else values[field]
        if chosen and name and (name != sight.probe or not names):
            await self._follower.do(lambda arm: arm.probe(name))

    def _turn_unit(self) -> None:
        self._choices.unit = INCH if self._choices.unit is MM else MM
        self._changed()

    def _turn_system(self) -> None:
        self._choices.of_part = not self._choices.of_part
        self._changed()

    async def _change_nominal(self) -> None:
        unit, nominal = self._choices.unit, self._choices.nominal
        present = nominal.xyz_mm if nominal else (None, None, None)
        fields = {
            f"{axis} in {unit.name}": "" if value is None else unit.text(value)
            for axis, value in zip(NAMES, present, strict=True)
        }
        tolerance = f"Tolerance ± in {unit.name}"
        fields[tolerance] = unit.text(nominal.tolerance_mm) if nominal else ""
        action, values = await self._dialogs.ask(
            "Where should it be, and how far off may it be?",
            ("Set", "Clear"),
            fields,
            "In the coordinates that are shown; leave empty what does not matter.",
        )
        if action == "Clear":
            self._choices.nominal = None
        elif action:
            try:
                *coordinates, permitted = (
                    float(value.replace(",", ".")) / unit.per_mm if value else None
                    for value in values.values()
                )
            except ValueError as error:
                self._follower.sight.refuse(str(error), "write numbers such as 12.345")
                return
            if (
                permitted is None
                or permitted <= 0
                or not any(v is not None for v in coordinates)
            ):
                self._follower.sight.refuse(
                    "a nominal place without tolerance or without a coordinate",
                    "give a tolerance above 0 and one coordinate at least",
                )
                return
            self._choices.nominal = Nominal(tuple(coordinates), permitted)
        self._changed()

    async def _change_spacing(self) -> None:
        unit, spacing_mm = self._choices.unit, self._choices.scan_spacing_mm
        field = f"Spacing in {unit.name}"
        action, values = await self._dialogs.ask(
            "How far apart are the points of a scan?",
            ("Set", "By time"),
            {field: "" if spacing_mm is None else unit.text(spacing_mm)},
            "Of the next scan: a point after each such distance, or as often as the "
            "daemon's configuration says.",
        )
        if action == "Set":
            try:
                entered = float(values[field].replace(",", ".")) / unit.per_mm
            except ValueError:
                entered = 0.0
            if not 0.0 < entered < inf:
                self._follower.sight.refuse(
                    f"{values[field] or 'nothing'} is no spacing",
                    f"write a number of {unit.name} above 0, such as 0.5",
                )
                return
            self._choices.scan_spacing_mm = entered
        elif action:
            self._choices.scan_spacing_mm = None
        self._changed()


def _button(
    act: Callable[[], Awaitable[None] | None], kind: str = "outline"
) -> ui.button:
    return ui.button(on_click=act, color=None).props(f"{kind} dense no-caps")
