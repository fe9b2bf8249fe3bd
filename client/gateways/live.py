"""A WebSocket server of Foxglove's protocol that shows an arm as it measures."""

import asyncio
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Any, Self

import foxglove
from foxglove import Channel, Context
from foxglove.channels import (
    FrameTransformChannel,
    JointStatesChannel,
    SceneUpdateChannel,
)
from foxglove.messages import SceneUpdate
from foxglove.websocket import Client, ServerListener, StatusLevel, WebSocketServer

from traverse.client.arm import Arm
from traverse.client.cancel_tasks import run_together
from traverse.client.gateways.live_scene import (
    arm_entity,
    ball_frame,
    deletion,
    joint_states,
    point_entity,
)
from traverse.client.gateways.outlets import Report, url_of
from traverse.client.points.doubts import SentPoints
from traverse.client.points.session_order import Lost
from traverse.protocol.messages import Health, Message, Point, Status
from traverse.recording.views import (
    VIEW_NAMES,
    VIEW_SCHEMAS,
    cloud_to_bytes,
    log_to_bytes,
    point_to_bytes,
    pose_to_bytes,
)

MAX_POINTS = 1000  # the newest are shown
ARM_ASSET = "package://traverse/arm.urdf"
BACKLOG = 128  # messages that wait for one viewer; then the oldest is lost
LOOK_S = 0.5
_LEVELS = {
    "info": StatusLevel.Info,
    "warning": StatusLevel.Warning,
    "error": StatusLevel.Error,
}


class _Listener(ServerListener):
    """Called by the server, in a thread of its own."""

    def __init__(self, on_subscribe: Callable[[], None]) -> None:
        self._on_subscribe = on_subscribe

    def on_subscribe(self, client: Client, channel: Any) -> None:  # noqa: ANN401
        self._on_subscribe()


class LiveServer:
    """Shows one arm to viewers; use with `async with`.

    Topics `point`, `pose`, `cloud`, `log` are as in a recording, with its schemas;
    `arm` and `points` are scenes, `joints` the readings, `tf` the ball's frame,
    `status` and `health` the messages themselves. A viewer that reads too slowly loses
    the oldest of `BACKLOG` messages.

    Args:
        report: called with messages for people.
        joints: their names, from the base outwards.
        urdf: the arm's description, which viewers get as `ARM_ASSET`; empty for none.

    Attributes:
        port: that is listened on.
    """

    def __init__(
        self,
        arm: Arm,
        host: str,
        port: int,
        times: float,
        report: Report,
        *,
        joints: Sequence[str] = (),
        urdf: str = "",
    ) -> None:
        self._arm = arm
        self._host, self.port = host, port
        self._times = times
        self._report = report
        self._joints = joints
        self._assets = {ARM_ASSET: urdf.encode()} if urdf else {}
        context = Context()
        self._context = context
        self._scene_of_arm = SceneUpdateChannel("arm", context=context)
        self._scene_of_points = SceneUpdateChannel("points", context=context)
        self._joint_states = JointStatesChannel("joints", context=context)
        self._frames = FrameTransformChannel("tf", context=context)
        self._views = {
            topic: Channel(
                topic,
                schema={"title": VIEW_NAMES[topic], **schema},
                message_encoding="json",
                context=context,
            )
            for topic, schema in VIEW_SCHEMAS.items()
        }
        self._states: dict[type[Message], Channel] = {
            kind: Channel(
                kind.__name__.lower(),
                schema={
                    **kind.model_json_schema(),
                    "title": f"traverse.{kind.__name__}",
                },
                message_encoding="json",
                context=context,
            )
            for kind in (Status, Health)
        }
        self._shown = SentPoints(MAX_POINTS)
        self._latest: dict[type[Message], Message] = {}
        self._alarms: dict[str, tuple[str, StatusLevel]] = {}
        self._subscribed = asyncio.Event()
        self._server: WebSocketServer | None = None
        self.points = 0

    @property
    def address(self) -> str:
        return url_of("ws", self._host, self.port)

    async def __aenter__(self) -> Self:
        loop = asyncio.get_running_loop()

        def on_subscribe() -> None:
            with suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(self._subscribed.set)

        try:
            self._server = foxglove.start_server(
                name=f"Traverse, arm {self._arm.name}",
                host=self._host,
                port=self.port,
                context=self._context,
                server_listener=_Listener(on_subscribe),
                asset_handler=self._assets.get,
                message_backlog_size=BACKLOG,
            )
        except RuntimeError as error:  # the library has one error for all
            raise ValueError(f"{self.address}: {error}; name another port") from error
        self.port = self._server.port
        return self

    async def __aexit__(self, *raised: object) -> None:
        if self._server is not None:
            await asyncio.to_thread(self._server.stop)

    async def serve(self) -> None:
        """Show messages until the arm's client is closed."""
        await run_together(
            *(self._show_points(), self._show_arm(), self._show_scans()),
            *(self._show_events(), self._show_state(), self._repeat()),
            self._show_doubts(),
        )

    async def _show_points(self) -> None:
        async for item in self._arm.points_and_losses():
            if isinstance(item, Lost):
                self._report(str(item))
                continue
            self._views["point"].log(point_to_bytes(item), log_time=item.time_ns)
            if item.retracts is not None:
                if (gone := self._shown.by_id.pop(item.retracts, None)) is not None:
                    self._take_away(gone)
                continue
            self._views["pose"].log(pose_to_bytes(item), log_time=item.time_ns)
            self.points += 1
            if (forgotten := self._shown.add(item)) is not None:
                self._take_away(forgotten)
            self._draw([item])

    async def _show_doubts(self) -> None:
        async for doubt in self._arm.doubts():
            self._draw(self._shown.doubt(doubt))

    def _draw(self, points: Iterable[Point]) -> None:
        entities = [point_entity(point, self._times) for point in points]
        self._scene_of_points.log(SceneUpdate(entities=entities))

    def _take_away(self, point: Point) -> None:
        deletions = [deletion(point.id, time.time_ns())]
        self._scene_of_points.log(SceneUpdate(deletions=deletions))

    async def _show_arm(self) -> None:
        async for live in self._arm.live():
            if self._scene_of_arm.has_sinks():
                entity = arm_entity(live, self._times)
                self._scene_of_arm.log(SceneUpdate(entities=[entity]))
            if self._joint_states.has_sinks():
                self._joint_states.log(joint_states(live, self._joints))
            if self._frames.has_sinks():
                self._frames.log(ball_frame(live))

    async def _show_scans(self) -> None:
        async for block in await self._arm.scans():
            if self._views["cloud"].has_sinks():
                self._views["cloud"].log(cloud_to_bytes(block), log_time=block.time_ns)

    async def _show_events(self) -> None:
        async for event in self._arm.events():
            self._views["log"].log(log_to_bytes(event), log_time=event.last_ns)

    async def _show_state(self) -> None:
        while True:
            for kind, ask in ((Status, self._arm.status), (Health, self._arm.health)):
                with suppress(TimeoutError):  # an arm that was never there
                    message = await ask()
                    if message != self._latest.get(kind):
                        self._latest[kind] = message
                        self._log_state(message)
            await asyncio.sleep(LOOK_S)

    async def _repeat(self) -> None:
        """Send earlier messages to a new viewer; the others get them again."""
        while True:
            await self._subscribed.wait()
            await asyncio.sleep(LOOK_S)  # a viewer subscribes to its topics one by one
            self._subscribed.clear()
            self._draw(self._shown.by_id.values())
            self._alarms.clear()
            for message in self._latest.values():
                self._log_state(message)

    def _log_state(self, message: Message) -> None:
        content = message.model_dump_json(by_alias=True).encode()
        self._states[type(message)].log(content)
        if not isinstance(message, Status):
            return
        if not message.online:  # where it was when it was last seen is not where it is
            deletions = [deletion("arm", time.time_ns())]
            self._scene_of_arm.log(SceneUpdate(deletions=deletions))
        alarms = {
            f"{alarm.code} {alarm.source}": (
                f"{alarm.text}; {alarm.remedy}",
                _LEVELS[alarm.severity],
            )
            for alarm in message.alarms
        }
        if not message.online:
            why = self._arm.absence or "the arm is offline"
            alarms["offline"] = (why, StatusLevel.Error)
        if self._server is None:
            return
        for name, (text, level) in alarms.items():
            if self._alarms.get(name) != (text, level):
                self._server.publish_status(f"{name}: {text}", level, name)
        if over := [name for name in self._alarms if name not in alarms]:
            self._server.remove_status(over)
        self._alarms = alarms
