"""The page of one browser: panels, what is done with them, and what they show."""

from collections.abc import Awaitable, Callable
from pathlib import Path

from nicegui import ui

from traverse.client.arm import Arm
from traverse.client.display.arm_state import Change
from traverse.client.display.condition import verdict
from traverse.client.display.follower import Follower
from traverse.client.page.arm_scene import ArmScene
from traverse.client.page.banner import Banner
from traverse.client.page.check_panel import CheckPanel
from traverse.client.page.controls import Controls, Soft
from traverse.client.page.health_tables import alarm_list, health_table
from traverse.client.page.points_panel import PointsPanel
from traverse.client.page.readout import Figures
from traverse.protocol.messages import Point

HERE = Path(__file__).parent
FAST_S = 0.05
SLOW_S = 0.5
CLOUD_S = 0.25
VIEWS = (
    ("Probe", "probe", "p"),
    ("All", "iso", "f"),
    ("Top", "top", "1"),
    ("Front", "front", "2"),
    ("Right", "right", "3"),
)
AVERAGE_S = 0.5


class OperatorPage:
    """Builds the page for one browser and keeps it up to date.

    Args:
        follower: of the arm.
        cloud_url: where scanned points are fetched.
        export: gives the points as a file: name and content.
    """

    def __init__(
        self,
        follower: Follower,
        cloud_url: str,
        export: Callable[[str, list[Point]], tuple[str, bytes]],
    ) -> None:
        self._follower = follower
        self._sight = follower.sight
        self._export = export
        self._seen_live: object = None
        self._seen_cloud = (-1, -1)
        self._session: str | None = None
        self._dark = ui.dark_mode(value=True)
        self._build(cloud_url)
        self._sight.listeners.append(self._changed)
        ui.context.client.on_delete(lambda: self._sight.listeners.remove(self._changed))
        ui.timer(FAST_S, self._fast)
        ui.timer(SLOW_S, self._slow)
        ui.timer(CLOUD_S, self._show_cloud)
        self._scene.on("vue:mounted", self._all_points)

    # -- how it is built --------------------------------------------------------

    def _build(self, cloud_url: str) -> None:
        ui.add_css(HERE / "page.css")
        ui.add_body_html(f"<script>{(HERE / 'sounds.js').read_text('utf-8')}</script>")
        with ui.element("main").classes("page"):
            self._banner = Banner(self._follower.name, self._mute, self._turn_light)
            self._figures = Figures()
            with ui.element("section").classes("panel scene-panel"):
                self._scene = ArmScene(cloud_url)
                with ui.element("div").classes("views"):
                    for name, view, key in VIEWS:
                        looking = self._looking(view)
                        button = ui.button(name, on_click=looking, color=None)
                        button.props(f'dense flat aria-keyshortcuts="{key.upper()}"')
            keys: dict[str, Callable[[], Awaitable[None] | None]] = {
                key: self._looking(view) for _, view, key in VIEWS
            }
            keys |= {"m": self._mute, "d": self._turn_light, "l": self._label}
            self._controls = Controls(
                [
                    Soft("Take point", " ", self._take, "take"),
                    Soft("Average", "a", self._average),
                    Soft("Undo", "u", self._undo),
                    Soft("Start scan", "s", self._turn_scan),
                    Soft("New session", "n", self._new_session),
                ],
                keys,
            )
            with ui.element("section").classes("lists"):
                self._points = PointsPanel(self._label, self._saving)
                self._check = CheckPanel()
                self._build_health()
        self._told = ui.label().classes("visually-hidden")
        self._told.props('role="status" aria-live="polite"')

    def _build_health(self) -> None:
        with ui.element("section").classes("panel"):
            ui.html("<h2>Health</h2>", sanitize=False)
            self._alarms = ui.html("", sanitize=False)
            self._health = ui.html("", sanitize=False)

    # -- what it shows ----------------------------------------------------------

    def _changed(self, change: Change) -> None:
        """Show at once what cannot wait for the timer."""
        if change.kind in ("point", "retraction", "refused", "alarm", "cleared"):
            self._run(f"traverse_sounds.play({change.kind!r})")
        if change.text:
            self._told.set_text(change.text)
        point = change.point
        if change.kind == "point" and point is not None:
            self._scene.add_points([point])
        elif point is not None and point.retracts is not None:
            self._scene.remove_point(point.retracts)
        elif change.kind == "refused":
            self._banner.tell_refused(change.text)
        if point is not None:
            self._show_points(point.id)
            self._check.take(point)
        if change.kind in ("alarm", "cleared", "link", "status"):
            self._show_verdict()
        session = self._sight.status.session if self._sight.status else None
        if session != self._session:
            self._session = session
            self._scene.clear_points()
            self._show_points(None)

    def _fast(self) -> None:
        live = self._sight.live
        self._figures.show(self._sight)
        if live is not None and live is not self._seen_live:
            self._seen_live = live
            self._scene.show_pose(live)

    def _slow(self) -> None:
        self._show_verdict()
        self._health.set_content(health_table(self._sight))
        self._alarms.set_content(alarm_list(self._sight))
        self._check.show_coverage(self._sight)
        scan = self._sight.scan
        runs = scan is not None and not scan.last
        self._controls.name("s", "Stop scan" if runs else "Start scan", is_on=runs)

    def _show_cloud(self) -> None:
        cloud = self._follower.cloud
        if (cloud.version, cloud.n_seen) != self._seen_cloud:
            self._seen_cloud = (cloud.version, cloud.n_seen)
            self._scene.show_cloud(cloud.version, cloud.n_kept, cloud.n_seen)

    def _show_verdict(self) -> None:
        self._banner.show(verdict(self._sight))

    def _show_points(self, newest: str | None) -> None:
        points = list(self._sight.points.values())
        self._points.show(points, self._sight.lost_points, newest)

    def _all_points(self) -> None:
        self._scene.theme(dark=bool(self._dark.value))
        self._scene.add_points(list(self._sight.points.values()))
        self._show_points(None)
        self._scene.forget_pose()
        self._seen_live, self._seen_cloud = None, (-1, -1)

    # -- what is done -----------------------------------------------------------

    async def _take(self) -> None:
        await self._follower.do(lambda arm: arm.capture())

    async def _average(self) -> None:
        await self._follower.do(lambda arm: arm.capture(dwell_s=AVERAGE_S))

    async def _undo(self) -> None:
        await self._follower.do(lambda arm: arm.undo())

    async def _new_session(self) -> None:
        await self._follower.do(lambda arm: arm.new_session())

    async def _turn_scan(self) -> None:
        scan = self._sight.scan
        runs = scan is not None and not scan.last

        async def turn(arm: Arm) -> None:
            if runs:
                await arm.stop_scan()
            else:
                await arm.start_scan()

        await self._follower.do(turn)

    async def _label(self) -> None:
        with ui.dialog() as dialog, ui.card():
            ui.label("What are the next points taken on?").classes("text-lg")
            artefact = ui.input("Artefact").props("autofocus")
            feature = ui.input("Feature")
            with ui.row():
                ui.button("Set", on_click=lambda: dialog.submit(True))
                ui.button("Clear", on_click=lambda: dialog.submit(False)).props("flat")
                ui.button("Cancel", on_click=dialog.close).props("flat")
        answer = await dialog
        dialog.delete()
        if answer is not None:
            names = (artefact.value or None, feature.value or None) if answer else ()
            await self._follower.do(lambda arm: arm.label(*names))

    def _saving(self, kind: str) -> Callable[[], None]:
        def save() -> None:
            points = list(self._sight.points.values())
            name, content = self._export(kind, points)
            ui.download(content, name)

        return save

    def _looking(self, view: str) -> Callable[[], None]:
        return lambda: self._scene.view(view)

    def _mute(self) -> None:
        muted = str(self._banner.turn_sound()).lower()
        self._run(f"traverse_sounds.muted = {muted}")

    def _turn_light(self) -> None:
        self._dark.toggle()
        is_dark = bool(self._dark.value)
        self._banner.name_light(is_dark=is_dark)
        self._scene.theme(dark=is_dark)

    def _run(self, script: str) -> None:
        self._scene.client.run_javascript(script)
