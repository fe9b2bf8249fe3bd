"""The page of one browser: panels, actions, updates."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from nicegui import ui

from traverse.client.display.arm_state import Change
from traverse.client.display.condition import obstacle, verdict
from traverse.client.display.figures import place_mm
from traverse.client.display.follower import Follower
from traverse.client.display.guided_check import CheckDesk
from traverse.client.display.inspection_desk import InspectionDesk
from traverse.client.page.arm_scene import ArmScene
from traverse.client.page.banner import Banner
from traverse.client.page.check_panel import CheckPanel
from traverse.client.page.controls import Act, Controls, Dialogs, Soft
from traverse.client.page.health_tables import alarm_list, condition_list, health_table
from traverse.client.page.language import add_languages
from traverse.client.page.part_panel import PartPanel
from traverse.client.page.points_panel import PointsPanel
from traverse.client.page.presses import Presses
from traverse.client.page.readout import NAMES, Choices, Figures
from traverse.client.page.setup_bar import SetupBar
from traverse.plurals import counted
from traverse.protocol.messages import Point

HERE = Path(__file__).parent
FAST_S = 0.05
SLOW_S = 0.5
CLOUD_S = 0.25
PART_S = 0.25
VIEWS = (
    ("Probe", "probe", "p"),
    ("All", "iso", "f"),
    ("Top", "top", "1"),
    ("Front", "front", "2"),
    ("Right", "right", "3"),
)
AVERAGE_S = 0.5


class OperatorPage:
    """Builds the page for one browser and updates it.

    Args:
        inspection: the part that is measured.
        export: returns the points as a file: name and content.
    """

    def __init__(
        self,
        follower: Follower,
        desk: CheckDesk,
        inspection: InspectionDesk,
        choices: Choices,
        *,
        cloud_url: str,
        export: Callable[[str, list[Point]], tuple[str, bytes]],
    ) -> None:
        self._follower = follower
        self._sight = follower.sight
        self._choices = choices
        self._export = export
        self._presses = Presses()
        self._dialogs = Dialogs(self._presses)
        self._seen_live: object = None
        self._seen_cloud = (-1, -1)
        self._seen_points: object = None
        self._was_stale: bool | None = None
        self._was_online = self._sight.is_online
        self._is_gone = False
        self._dark = ui.dark_mode(value=True)
        self._build(desk, inspection, cloud_url)
        self._sight.listeners.append(self._changed)
        ui.context.client.on_delete(lambda: self._sight.listeners.remove(self._changed))
        ui.timer(FAST_S, self._fast)
        ui.timer(SLOW_S, self._slow)
        ui.timer(CLOUD_S, self._show_cloud)
        ui.timer(PART_S, self._part.measure)
        self._scene.on("vue:mounted", self._all_anew)

    # -- how it is built --------------------------------------------------------

    def _build(
        self, desk: CheckDesk, inspection: InspectionDesk, cloud_url: str
    ) -> None:
        ui.add_css(HERE / "page.css")
        for script in ("sounds.js", "watch.js"):
            text = (HERE / script).read_text("utf-8")
            ui.add_body_html(f"<script>{text}</script>")
        add_languages()
        with ui.element("div").classes("page"):  # within the main of the framework
            self._banner = Banner(
                self._follower.name,
                mute=self._mute,
                speak=self._turn_speech,
                turn_digits=self._turn_digits,
                turn_light=self._turn_light,
            )
            self._figures = Figures(self._choices)
            self._setup = SetupBar(
                self._follower,
                self._choices,
                self._dialogs,
                self._presses,
                self._show_choices,
            )
            with ui.element("section").classes("panel scene-panel"):
                self._scene = ArmScene(cloud_url)
                with ui.element("div").classes("views"):
                    for name, view, key in VIEWS:
                        look = partial(self._scene.view, view)
                        button = ui.button(name, on_click=look, color=None)
                        button.props(f'dense flat aria-keyshortcuts="{key.upper()}"')
            keys: dict[str, Act] = {
                key: partial(self._scene.view, view) for _, view, key in VIEWS
            }
            keys |= {
                "m": self._mute,
                "v": self._turn_speech,
                "g": self._turn_digits,
                "d": self._turn_light,
                "l": self._setup.change_label,
            }
            self._controls = Controls(
                [
                    Soft("Take point", " ", self._take, "take", needs_pose=True),
                    Soft("Mean of 0.5 s", "a", self._average, needs_pose=True),
                    Soft("Undo", "u", self._follower.undo_shown),
                    Soft("Start scan", "s", self._turn_scan, needs_pose=True),
                    Soft("New session", "n", self._new_session),
                ],
                keys,
                lambda: self._dialogs.is_open,
                self._presses,
            )
            self._part = PartPanel(
                self._follower, inspection, self._dialogs, self._presses
            )
            self._controls.add_key("e", self._part.accept_or_repeat)
            with ui.element("section").classes("lists"):
                self._points = PointsPanel(
                    self._choices, self._save, self._show_session
                )
                self._check = CheckPanel(
                    self._follower, desk, self._dialogs, self._presses
                )
                with (
                    ui.element("section")
                    .classes("panel")
                    .props('tabindex="0" aria-label="Health"')
                ):
                    ui.html("<h2>Health</h2>", sanitize=False)
                    self._conditions = ui.html("", sanitize=False)
                    self._alarms = ui.html("", sanitize=False)
                    self._health = ui.html("", sanitize=False)

    # -- what it shows ----------------------------------------------------------

    def _changed(self, change: Change) -> None:
        """Show changes that cannot wait for the timer."""
        kind, point = change.kind, change.point
        if kind == "point" and point is not None and not point.quality.ok:
            kind = "doubt"
        if kind in ("link", "status", "absent"):
            self._show_verdict()
            self._notify_absence()
        elif kind != "stored":
            self._play(kind)
            self._banner.tell(kind, change.text)
        if kind in ("alarm", "cleared"):
            self._show_verdict()
        if change.kind == "point" and point is not None:
            self._speak(point)
        if kind == "stored" or point is None:
            return  # late points, or those of another session: see `_fast`
        self._show_points(point.id)
        self._check.show()

    def _notify_absence(self) -> None:
        """Notify that broker or arm are gone, or back."""
        is_online = self._sight.is_online
        if self._was_online and not is_online:
            self._is_gone = True
            self._play("alarm")
            self._banner.tell("alarm", verdict(self._sight).sentence)
        elif is_online and self._is_gone:
            self._is_gone = False
            self._play("cleared")
            self._banner.tell("cleared", "The arm is back.")
        self._was_online = is_online

    def _fast(self) -> None:
        sight = self._sight
        self._figures.show(sight)
        if sight.live is not None and sight.live is not self._seen_live:
            self._seen_live = sight.live
            self._scene.show_pose(sight.live)
        if sight.is_stale != self._was_stale:
            self._was_stale = sight.is_stale
            self._scene.show_age(is_stale=sight.is_stale)
        if self._points_key() != self._seen_points:
            self._show_points(None)
            self._check.show()

    def _slow(self) -> None:
        sight = self._sight
        self._show_verdict()
        self._setup.show(sight)
        self._health.set_content(health_table(sight))
        self._conditions.set_content(condition_list(sight))
        self._alarms.set_content(alarm_list(sight))
        self._check.show_coverage(sight)
        self._points.show_age(sight)

    def _show_cloud(self) -> None:
        cloud = self._follower.cloud
        if (cloud.version, cloud.n_seen) != self._seen_cloud:
            self._seen_cloud = (cloud.version, cloud.n_seen)
            self._scene.show_cloud(cloud.version)

    def _show_verdict(self) -> None:
        sight = self._sight
        self._banner.show(verdict(sight))
        runs = sight.scan is not None and sight.scan.runs
        self._controls.name("s", "Stop scan" if runs else "Start scan", is_on=runs)
        last = sight.last_point
        self._controls.name("u", "Undo" if last is None else f"Undo {last.seq}")
        self._controls.allow(
            lambda soft: (
                not obstacle(
                    sight, needs_pose=soft.needs_pose and not (runs and soft.key == "s")
                )
            )
        )

    def _show_points(self, newest: str | None) -> None:
        self._seen_points = self._points_key()
        self._scene.show_points(self._sight.points)
        self._points.show(self._sight, newest)

    def _points_key(self) -> tuple[object, ...]:
        sight, points = self._sight, self._sight.points
        session = sight.shown_session or sight.session
        last = next(reversed(points), "")
        system = self._choices.system(sight)
        shown = (system, self._choices.unit, sight.aligned_ns, sight.earlier_session)
        return (session, len(points), last, sight.lost_points, *shown)

    def _show_choices(self) -> None:
        self._setup.show(self._sight)
        self._figures.show(self._sight)
        self._show_points(None)

    def _show_session(self, session: str | None) -> None:
        self._sight.shown_session = session

    def _all_anew(self) -> None:
        """Refresh everything: the browser was opened or reloaded."""
        self._scene.theme(dark=bool(self._dark.value))
        self._scene.forget()
        self._seen_live, self._seen_cloud, self._was_stale = None, (-1, -1), None
        self._seen_points = None

    # -- what is done -----------------------------------------------------------

    async def _take(self) -> None:
        await self._follower.do(lambda arm: arm.capture(), needs_pose=True)

    async def _average(self) -> None:
        await self._follower.do(
            lambda arm: arm.capture(dwell_s=AVERAGE_S), needs_pose=True
        )

    async def _turn_scan(self) -> None:
        await self._follower.turn_scan(self._choices.scan_spacing_mm)

    async def _new_session(self) -> None:
        n = len(self._sight.sessions.get(self._sight.session, {}))
        answer, values = await self._dialogs.ask(
            "Begin a new session with an empty list? It has "
            f"{counted(n, 'point')} now.",
            ("New session",),
            {"Note, for people": ""},
            "The points stay on the arm's disk, and here: Earlier session shows them "
            "again.",
        )
        if answer:
            (note,) = values.values()
            await self._follower.do(lambda arm: arm.new_session(note or None))

    def _save(self, kind: str) -> None:
        name, content = self._export(kind, list(self._sight.points.values()))
        ui.download(content, name)

    def _mute(self) -> None:
        muted = str(self._banner.turn_sound()).lower()
        self._run(f"traverse_sounds.muted = {muted}")

    def _turn_speech(self) -> None:
        speaks = str(self._banner.turn_speech()).lower()
        self._run(f"traverse_sounds.speaks = {speaks}")

    def _turn_digits(self) -> None:
        self._run("document.body.classList.toggle('digits')")

    def _speak(self, point: Point) -> None:
        unit = self._choices.unit
        of_system = place_mm(point, self._choices.system(self._sight)) or point.xyz_mm
        words = ", ".join(
            f"{axis} {unit.text(value)}"
            for axis, value in zip(NAMES, of_system, strict=True)
        )
        self._run(f"traverse_sounds.speak({words!r})")

    def _turn_light(self) -> None:
        self._dark.toggle()
        is_dark = bool(self._dark.value)
        self._banner.name_light(is_dark=is_dark)
        self._scene.theme(dark=is_dark)

    def _play(self, kind: str) -> None:
        self._run(f"traverse_sounds.play({kind!r})")

    def _run(self, script: str) -> None:
        self._scene.client.run_javascript(script)
