"""A part measured by touches: features, relations, tolerances, the report."""

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from functools import partial

from nicegui import ui

from traverse.client.display.follower import Follower
from traverse.client.display.inspection_desk import GOOD_COUNTS, WHERE, InspectionDesk
from traverse.client.inspection.drawing import dxf_text
from traverse.client.inspection.plan import (
    PartTemperature,
    Plan,
    RelationKind,
    ToleranceEntry,
)
from traverse.client.inspection.qif import qif_text
from traverse.client.inspection.sheet import csv_text, figure_words, json_text
from traverse.client.inspection.values import (
    FeatureResult,
    FigureResult,
    Inspection,
    TouchResult,
)
from traverse.client.page.controls import Dialogs
from traverse.client.page.part_alignment import NOT_MOVED, PartAlignment
from traverse.client.page.presses import Presses
from traverse.kinematics.features.measured import Side
from traverse.kinematics.fits.elements import LEAST_POINTS, Kind
from traverse.plurals import counted

KINDS: tuple[Kind, ...] = (
    *("point", "line", "plane", "circle", "sphere", "cylinder", "cone"),
)
RELATIONS: tuple[RelationKind, ...] = (
    *("distance", "angle", "intersection", "projection", "symmetry", "apex"),
)
SIDES: dict[Side, str] = {
    "auto": "Side: as compensated",
    "inside": "Side: inside (hole)",
    "outside": "Side: outside (shaft)",
    "centre": "Side: ball centre",
}
CONDITIONS = (
    "Ball's radius: uncertainty in mm",
    "Part's temperature in °C",
    "Its uncertainty in °C",
    "Expansion of its material per °C",
    "Uncertainty of the expansion per °C",
)
LEVELS = {"conforming": "good", "not conforming": "bad"}
REPORT_URL = "/report"
_FILES: dict[str, Callable[[Inspection], str]] = {
    "csv": csv_text,
    "json": json_text,
    "dxf": dxf_text,
    "qif": qif_text,
}


class PartPanel:
    """Created where it is displayed.

    Args:
        follower: of the arm; labels points with their feature.
    """

    def __init__(
        self,
        follower: Follower,
        desk: InspectionDesk,
        dialogs: Dialogs,
        presses: Presses,
    ) -> None:
        self._follower = follower
        self._desk = desk
        self._dialogs = dialogs
        self._alignment = PartAlignment(follower, desk, dialogs)
        self._guard = presses.guard
        self._shown: object = None
        self._last_kind: Kind | None = None
        # Kept, not made anew: a press may be on its way to one.
        self._row_of: dict[str, tuple[ui.button, ui.label]] = {}
        self._touch_of: dict[str, ui.button] = {}
        with ui.element("section").classes("panel part") as panel:
            panel.props('tabindex="0" aria-label="Part"')
            with ui.element("div").classes("bar"):
                self._title = ui.html("<h2>Part</h2>", sanitize=False)
                ui.space()
                self._button("About", self._change_about)
                self._button("Conditions", self._change_conditions)
                self._button("New part", self._begin_part)
                report = self._button(
                    "Report", partial(ui.navigate.to, REPORT_URL, new_tab=True)
                )
                report.props('aria-label="Open the report sheet"')
                for kind in _FILES:
                    name = kind.upper()
                    file = self._button(name, partial(self._save, kind), "flat")
                    file.props(f'aria-label="Save results as {name}"')
            with ui.element("div").classes("touching") as self._touching:
                self._instruction = ui.label().classes("asks")
                self._instruction.props('aria-live="polite"')
                self._live = ui.label().classes("result")
                with ui.element("div").classes("bar"):
                    self._accept = self._button("Accept", self._end, "unelevated")
                    self._accept.classes("accept")
                    self._side = self._button("Side", self._turn_side)
                    self._plane = self._button("Plane of it", self._turn_plane)
                self._touches = ui.element("div").classes("bar touches")
            with ui.element("div").classes("bar kinds") as self._kinds:
                self._kinds.props('role="group" aria-label="Touch a feature"')
                for of in KINDS:
                    self._button(of.capitalize(), partial(self._begin, of))
            with ui.element("div").classes("bar relations") as self._relations:
                self._relations.props('role="group" aria-label="Relate features"')
                for relation in RELATIONS:
                    self._button(relation.capitalize(), partial(self._relate, relation))
                self._button("Align 3-2-1", self._alignment.by_datums)
                self._button("Align best fit", self._alignment.by_best_fit)
                self._button("Arm moved", self._alignment.begin_leapfrog)
            with ui.element("div").classes("bar") as self._moved:
                self._moved.props('role="group" aria-label="Leapfrog"')
                ui.label("The arm was moved: touch features again, then join them.")
                self._button("Join", self._alignment.end_leapfrog, "unelevated")
                self._button(NOT_MOVED, self._alignment.give_up_leapfrog)
            self._left_out = ui.label().classes("left-out")
            self._rows = ui.element("div").classes("features")
        self.show()

    def _button(
        self,
        name: str,
        act: Callable[[], Awaitable[None] | None],
        look: str = "outline",
    ) -> ui.button:
        button = ui.button(name, on_click=self._guard(act), color=None)
        return button.props(f"{look} dense no-caps")

    async def measure(self) -> None:
        await self._desk.measure(self._follower.shared_errors)
        self.show()

    def show(self) -> None:
        desk = self._desk
        scanned = None if desk.scanned is None else desk.scanned.part
        key = (desk.version, desk.inspection, scanned)
        if key == self._shown:
            return
        self._shown = key
        self._show_active()
        unjudged = (
            desk.inspection.left_out if desk.tolerances and desk.inspection else ()
        )
        self._left_out.set_text(". ".join(unjudged))
        names = (*desk.features, *desk.relations)
        for removed_name in self._row_of.keys() - set(names):
            self._row_of.pop(removed_name)[0].delete()
        for name in names:
            if name not in self._row_of:
                self._row_of[name] = self._new_row(name)
            self._show_row(name)

    def _show_active(self) -> None:
        desk, name = self._desk, self._desk.active
        self._touching.set_visibility(name is not None)
        is_free = name is None and not desk.stations.is_moved
        self._kinds.set_visibility(is_free)
        self._relations.set_visibility(is_free)
        self._moved.set_visibility(name is None and desk.stations.is_moved)
        if name is None:
            return
        draft = desk.features[name]
        result = desk.result(name)
        least, good = LEAST_POINTS[draft.kind], GOOD_COUNTS[draft.kind]
        required = f"at least {least}" + (f", good are {good}" if good > least else "")
        so_far = counted(desk.touches_of(name), "touch")
        self._instruction.set_text(f"{name}: {WHERE[draft.kind]} {so_far}; {required}.")
        words = "" if result is None else _words(result)
        if desk.scanned is not None:
            words = desk.scanned.part.words
        self._live.set_text(words)
        is_round = draft.kind not in ("point", "line", "plane")
        self._side.set_visibility(is_round)
        self._side.set_text(SIDES[draft.side])
        self._plane.set_visibility(draft.kind in ("circle", "line"))
        self._plane.set_text(f"In: {draft.plane or 'its own touches'}")
        self._show_touches(result)

    def _show_touches(self, result: FeatureResult | None) -> None:
        result = result or FeatureResult("", "")
        shown: dict[str, tuple[str, str, str, Sequence[TouchResult]]] = {}
        for touch in result.touches:
            if not touch.scan:
                off = "" if touch.distance_mm is None else f" {touch.distance_mm:+.3f}"
                title = f"Touch {touch.seq}"
                shown[touch.id] = title, f"{title}{off}", f"{touch.seq}:{off}", [touch]
        for part in result.scans:
            samples = [t for t in result.touches if t.scan == part.scan]
            title = f"Scan {part.scan}"
            shown[part.scan] = title, title, part.words, samples
        for removed in self._touch_of.keys() - shown.keys():
            self._touch_of.pop(removed).delete()
        for key, (title, label, text, of) in shown.items():
            button = self._touch_of.get(key)
            if button is None:
                act = partial(self._ask_touch, title, key)
                with self._touches:
                    self._touch_of[key] = button = self._button("", act)
            button.set_text(text)
            is_doubtful = any(touch.doubts for touch in of)
            button.classes("doubt" if is_doubtful else "", remove="doubt")
            button.props(f'aria-label="{label}: move or leave out"')

    def _new_row(self, name: str) -> tuple[ui.button, ui.label]:
        with self._rows:
            row = self._button("", partial(self._ask_feature, name), "flat")
        with row.classes("feature"):
            ui.label(name).classes("name").props('translate="no"')
            words = ui.label()
        return row, words

    def _show_row(self, name: str) -> None:
        row, words = self._row_of[name]
        row.set_visibility(name != self._desk.active)
        result = self._desk.result(name)
        words.set_text("" if result is None else _words(result))
        decisions = [] if result is None else [f.conformity for f in result.figures]
        levels = {LEVELS.get(d, "warning") for d in decisions if d is not None}
        worst = next(
            (level for level in ("bad", "warning", "good") if level in levels), ""
        )
        look = f"state {worst}" if worst else "figures-of"
        words.classes(look, remove="state bad warning good figures-of")

    # -- what is done -------------------------------------------------------------

    async def _begin(self, kind: Kind) -> None:
        if await self._touch(lambda desk: desk.begin(kind)):
            self._last_kind = kind

    async def _touch(self, choose: Callable[[InspectionDesk], str]) -> bool:
        """Have new points belong to the chosen feature; False if it is refused."""
        self._desk.accept()
        try:
            name = choose(self._desk)
        except ValueError as error:
            self._follower.sight.refuse(str(error))
            return False
        self.show()
        part = self._desk.part or "part"
        await self._follower.do(lambda arm: arm.label(part, name))
        return True

    async def accept_or_repeat(self) -> None:
        """Accept the feature that is touched; else begin another of the last kind."""
        if self._desk.active is not None:
            await self._end()
        elif self._last_kind is not None:
            await self._begin(self._last_kind)

    async def _end(self) -> None:
        self._desk.accept()
        self.show()
        await self._follower.do(lambda arm: arm.label())

    def _turn_side(self) -> None:
        draft = self._desk.features[self._desk.active or ""]
        sides = list(SIDES)
        draft.side = sides[(sides.index(draft.side) + 1) % len(sides)]
        self._desk.version += 1
        self.show()

    def _turn_plane(self) -> None:
        desk = self._desk
        draft = desk.features[desk.active or ""]
        planes = [n for n, feature in desk.features.items() if feature.kind == "plane"]
        choices = [None, *planes]
        draft.plane = choices[(choices.index(draft.plane) + 1) % len(choices)]
        desk.version += 1
        self.show()

    async def _ask_touch(self, title: str, key: str) -> None:
        desk, active = self._desk, self._desk.active
        other_features = [name for name in desk.features if name != active]
        answer, _ = await self._dialogs.ask(
            f"{title} does not belong here?",
            ("Leave it out", *(f"Move to {name}" for name in other_features)),
        )
        result = desk.result(active or "")
        if answer and result is not None:
            to = answer.removeprefix("Move to ") if answer != "Leave it out" else None
            for touch in result.touches:
                if key in (touch.id, touch.scan):
                    desk.assign(touch.id, to)
            self.show()

    async def _ask_feature(self, name: str) -> None:
        desk, result = self._desk, self._desk.result(name)
        is_touched = name in desk.features
        figures = [] if result is None else [f.name for f in result.figures]
        answer, _ = await self._dialogs.ask(
            name,
            (
                *(("Touch more",) if is_touched else ()),
                *(f"Tolerance of {figure}" for figure in figures),
                "Remove",
            ),
            details="" if result is None else _listed(result, result.figures),
        )
        if answer == "Touch more":
            await self._touch(lambda desk: desk.touch(name))
        elif answer == "Remove":
            desk.remove(name)
        elif answer and result is not None:
            figure = answer.removeprefix("Tolerance of ")
            chosen = next(f for f in result.figures if f.name == figure)
            await self._ask_tolerance(name, chosen)
        self.show()

    async def _ask_tolerance(self, name: str, figure: FigureResult) -> None:
        unit, key = figure.unit, (name, figure.name)
        present = self._desk.tolerances.get(key)
        names = {limit: f"{limit}_{unit}" for limit in ("nominal", "lower", "upper")}
        values = {
            limit: "" if present is None else f"{getattr(present, of_entry):g}"
            for limit, of_entry in names.items()
        }
        answer, limit_texts = await self._dialogs.ask(
            f"Tolerance of {figure.name} of {name} in {unit}",
            ("Set", "Clear"),
            {limit.capitalize(): value for limit, value in values.items()},
            "Lower and upper are counted from the nominal value: such as -0.1 and 0.1.",
        )
        if answer == "Clear":
            self._desk.set_tolerance(None, key)
        if answer != "Set":
            return
        try:
            numbers = {
                names[limit.lower()]: float(text.replace(",", "."))
                for limit, text in limit_texts.items()
            }
            entry = ToleranceEntry.model_validate(
                {"of": name, "figure": figure.name, **numbers}
            )
        except ValueError:
            self._follower.sight.refuse(
                "this is no tolerance",
                "write three numbers, the lower limit below the upper one",
            )
            return
        self._desk.set_tolerance(entry, key)

    async def _relate(self, kind: RelationKind) -> None:
        names = [*self._desk.features, *self._desk.relations]
        places = ("Which cone?",) if kind == "apex" else ("First?", "Second?")
        title = kind.capitalize()
        chosen = await self._alignment.choose(title, places, names)
        if chosen:
            self._desk.relate(kind, chosen)
            self.show()

    async def _change_about(self) -> None:
        desk = self._desk
        fields = {
            "Part": desk.part,
            "Serial number": desk.serial,
            "Operator": desk.operator,
        }
        answer, values = await self._dialogs.ask(
            "What is measured, and by whom?", ("Set",), fields, "For the report."
        )
        if answer:
            part, serial, operator = (value[:60] for value in values.values())
            desk.set_about(part, serial, operator)

    async def _change_conditions(self) -> None:
        desk, part = self._desk, self._desk.part_temperature
        present = [
            desk.ball_radius_std_mm,
            *([None] * len(PartTemperature.model_fields)),
        ]
        if part is not None:
            present[1:] = part.model_dump().values()
        values = ["" if value is None else f"{value:g}" for value in present]
        answer, field_texts = await self._dialogs.ask(
            "What ball and part are like, each with its standard uncertainty",
            ("Set",),
            dict(zip(CONDITIONS, values, strict=True)),
            "Lengths are judged when all is stated, and are those at 20 °C. Steel "
            "expands by 1.15e-05 per °C (± 1e-06), aluminium by 2.3e-05 (± 1e-06).",
        )
        if not answer:
            return
        texts = [text.replace(",", ".") for text in field_texts.values()]
        try:
            ball_std_mm, *of_part = (float(text) if text else None for text in texts)
            table = dict(zip(PartTemperature.model_fields, of_part, strict=True))
            is_stated = any(number is not None for number in of_part)
            checked = Plan(
                ball_radius_std_mm=ball_std_mm,
                part_temperature=(
                    PartTemperature.model_validate(table) if is_stated else None
                ),
            )
        except ValueError:
            self._follower.sight.refuse(
                "these are no conditions",
                "write numbers; of the part all four, or none",
            )
            return
        desk.set_conditions(checked.ball_radius_std_mm, checked.part_temperature)
        self.show()

    async def _begin_part(self) -> None:
        answer, _ = await self._dialogs.ask(
            "Begin with another part? All features go; points stay in their session.",
            ("New part",),
        )
        if answer:
            self._desk.clear()
            self.show()

    async def _save(self, kind: str) -> None:
        inspection = self._desk.inspection
        if inspection is None:
            self._follower.sight.refuse("nothing is measured yet", "touch a feature")
            return
        try:
            text = await asyncio.to_thread(_FILES[kind], inspection)
        except ModuleNotFoundError as error:
            needs = f"a drawing needs {error.name}, which is not installed"
            self._follower.sight.refuse(needs, "install the extra `lab`")
            return
        ui.download(text.encode(), f"features.{kind}")


def _words(result: FeatureResult) -> str:
    """Return the figures that matter first: those with limits, else by kind."""
    figures = {figure.name: figure for figure in result.figures}
    shown = [figure for figure in result.figures if figure.conformity is not None]
    if not shown:
        is_point = "x" in figures and "diameter" not in figures
        order = "xyz" if is_point else ("diameter", "distance", "angle", "form")
        shown = [figures[name] for name in order if name in figures]
    return _listed(result, shown)


def _listed(result: FeatureResult, figures: Sequence[FigureResult]) -> str:
    if result.problem:
        return result.problem
    return "; ".join(f"{f.name} {' '.join(figure_words(f))}".strip() for f in figures)
