"""An OPC UA server of one arm: its state, its latest pose and point, points as events.

Doubt is the status code of a value, as OPC UA means it: a value in doubt is uncertain,
an outdated one is bad, so that clients that check status codes need to know nothing of
Traverse. Clients read; nothing can be written.

Sources: OPC 10000-3 to 10000-8 (address space, services, information model, data
access). Types of OPC 40210 (Geometric Measurement Systems) are not claimed: those
describe machines that run measurement routines.
"""

import asyncio
import logging
import math
import time
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, timedelta
from typing import Any, Self

from asyncua import ua
from asyncua.common.node import Node
from asyncua.server.event_generator import EventGenerator
from asyncua.server.server import Server
from asyncua.ua.status_codes import StatusCodes

from traverse.client.arm import Arm
from traverse.client.cancel_tasks import run_together
from traverse.client.gateways.outlets import Report, url_of
from traverse.client.points.doubts import SentPoints
from traverse.client.points.session_order import Lost
from traverse.protocol.messages import Live, Point, Status
from traverse.protocol.messages.point import Covariance
from traverse.protocol.messages.quality import Quality
from traverse.protocol.printable import printable

NAMESPACE = "urn:traverse:arm:1"
LOOK_S = 0.5
STALE_S = 1.0  # without a live pose
COVERAGE = 2.0
MILLIMETRE = ua.EUInformation(
    NamespaceUri="http://www.opcfoundation.org/UA/units/un/cefact",
    UnitId=int.from_bytes(b"MMT", "big"),  # the code of UN/CEFACT Recommendation 20
    DisplayName=ua.LocalizedText("mm"),
    Description=ua.LocalizedText("millimetre"),
)
EPOCH = ua.DateTime(1970, 1, 1, tzinfo=UTC)
GOOD_SEVERITY, DOUBT_SEVERITY = 100, 500  # of 1 to 1000

_DOUBLE, _TEXT = ua.VariantType.Double, ua.VariantType.String
_LENGTHS = ("X", "Y", "Z", "Ux", "Uy", "Uz", "PartX", "PartY", "PartZ", "ProbeRadius")
_POSE_FIELDS = {**dict.fromkeys(_LENGTHS, _DOUBLE), "Doubts": _TEXT}
_POINT_FIELDS = {
    **_POSE_FIELDS,
    "Id": _TEXT,
    "Session": _TEXT,
    "Sequence": ua.VariantType.UInt64,
    "Artefact": _TEXT,
    "Feature": _TEXT,
}
_EVENT_FIELDS = {**_POINT_FIELDS, "Retracts": _TEXT}
_STATE_FIELDS = {
    **dict.fromkeys(("State", "Session", "Probe", "Alignment"), _TEXT),
    **dict.fromkeys(("SoftwareRevision", "ArmFile"), _TEXT),
    "Online": ua.VariantType.Boolean,
}
_STATE_LISTS = ("Alarms", "Devices")

_GOOD = ua.StatusCode(ua.UInt32(StatusCodes.Good))
_UNCERTAIN = ua.StatusCode(ua.UInt32(StatusCodes.UncertainSensorNotAccurate))
_LAST_KNOWN = ua.StatusCode(ua.UInt32(StatusCodes.UncertainLastUsableValue))
_AWAY = ua.StatusCode(ua.UInt32(StatusCodes.BadNoCommunication))
_UNKNOWN = ua.StatusCode(ua.UInt32(StatusCodes.BadNoData))
_WAITING = ua.StatusCode(ua.UInt32(StatusCodes.BadWaitingForInitialData))


class OpcUaServer:
    """Serves one arm; use with `async with`.

    Args:
        port: to listen on; 0: any that is free.
        report: called with messages for people.
    """

    def __init__(self, arm: Arm, host: str, port: int, report: Report) -> None:
        # The library would print tracebacks; what people need is reported here.
        logging.getLogger("asyncua").setLevel(logging.CRITICAL + 1)
        self._arm = arm
        self._host, self._port = host, port
        self._report = report
        self._server = Server()
        self._state: dict[str, Node] = {}
        self._pose: dict[str, Node] = {}
        self._point: dict[str, Node] = {}
        self._events: EventGenerator | None = None
        self._live: Live | None = None
        self._live_at_s = -math.inf
        self._online = False
        self._sent = SentPoints()
        self.points = 0

    @property
    def address(self) -> str:
        return f"{url_of('opc.tcp', self._host, self._port)}/"

    async def __aenter__(self) -> Self:
        server = self._server
        await server.init()
        await server.set_application_uri(f"urn:traverse:{self._arm.name}")
        server.set_server_name(f"Traverse, arm {self._arm.name}")
        server.set_endpoint(self.address)
        server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        index = await server.register_namespace(NAMESPACE)
        arm = await server.nodes.objects.add_object(index, self._arm.name)
        self._state = await self._variables(index, arm, "State", _STATE_FIELDS)
        state = await arm.get_child(f"{index}:State")
        for name in _STATE_LISTS:
            self._state[name] = await state.add_variable(index, name, [], _TEXT)
        self._pose = await self._variables(index, arm, "LivePose", _POSE_FIELDS)
        self._point = await self._variables(index, arm, "LastPoint", _POINT_FIELDS)
        kind = await server.create_custom_event_type(
            index, "PointEventType", properties=list(_EVENT_FIELDS.items())
        )
        self._events = await server.get_event_generator(kind, arm.nodeid)
        await server.start()
        listening = server.bserver
        if self._port == 0 and listening is not None:
            self._port = listening.port
        return self

    async def _variables(
        self, index: int, arm: Node, name: str, fields: Mapping[str, ua.VariantType]
    ) -> dict[str, Node]:
        """Add an object with a variable for each field; none has a value yet."""
        parent = await arm.add_object(index, name)
        variables = {}
        for field, kind in fields.items():
            empty = ua.get_default_value(kind)
            variable = await parent.add_variable(index, field, empty, kind)
            if field in _LENGTHS:
                await variable.add_property(0, "EngineeringUnits", MILLIMETRE)
            variables[field] = variable
            await self._write(variable, ua.Variant(empty, kind), _WAITING)
        return variables

    async def __aexit__(self, *raised: object) -> None:
        await self._server.stop()

    async def serve(self) -> None:
        """Serve messages until the arm's client is closed."""
        await run_together(
            *(self._serve_points(), self._serve_doubts()),
            *(self._serve_pose(), self._serve_state()),
        )

    async def _serve_points(self) -> None:
        async for item in self._arm.points_and_losses():
            if isinstance(item, Lost):
                self._report(str(item))
                continue
            if item.retracts is None:
                self.points += 1
                self._sent.add(item)
                await self._write_point(item)
            else:
                self._sent.by_id.pop(item.retracts, None)
            await self._send_event(item)

    async def _serve_doubts(self) -> None:
        """Say of points that clients have that they are in doubt."""
        async for doubt in self._arm.doubts():
            for point in self._sent.doubt(doubt):
                if point.id == next(reversed(self._sent.by_id)):
                    await self._write_point(point)
                await self._send_event(point)

    async def _write_point(self, point: Point) -> None:
        values, code = _point_values(point), _code(point.quality)
        when = _date(point.time_ns)
        await self._write_all(self._point, _POINT_FIELDS, values, code, when)

    async def _send_event(self, point: Point) -> None:
        if self._events is None:
            return
        values, when = _point_values(point), _date(point.time_ns)
        event = self._events.event
        for name, kind in _EVENT_FIELDS.items():
            setattr(event, name, ua.Variant(values[name], kind))
        event.Severity = GOOD_SEVERITY if point.quality.ok else DOUBT_SEVERITY
        summary = f"point {point.seq} of session {point.session}"
        if point.retracts is not None:
            summary += f" takes back {point.retracts}"
        elif not point.quality.ok:
            summary += f" is in doubt: {values['Doubts']}"
        await self._events.trigger(when, summary)

    async def _serve_pose(self) -> None:
        async for live in self._arm.live():
            self._live, self._live_at_s = live, time.monotonic()
            if self._online:
                await self._write_pose(live, _code(live.quality))

    async def _write_pose(self, live: Live, code: ua.StatusCode) -> None:
        values = _pose_values(live)
        await self._write_all(
            self._pose, _POSE_FIELDS, values, code, _date(live.time_ns)
        )

    async def _serve_state(self) -> None:
        written: tuple[Status, str] | None = None
        while True:
            with suppress(TimeoutError):  # an arm that was never there
                status = await self._arm.status()
                if (status, self._arm.absence) != written:
                    written = status, self._arm.absence
                    await self._write_state(*written)
            if self._live is not None and not self._online:
                await self._write_pose(self._live, _AWAY)
            elif (
                self._live is not None and time.monotonic() - self._live_at_s > STALE_S
            ):
                await self._write_pose(self._live, _LAST_KNOWN)
            await asyncio.sleep(LOOK_S)

    async def _write_state(self, status: Status, absence: str) -> None:
        """Write a state.

        Args:
            status: of the arm; offline while nothing arrives from its daemon.
            absence: why nothing is known of it; else empty.
        """
        self._online = status.online
        values = {
            "Online": status.online,
            "State": status.state,
            "Session": status.session or "",
            "Probe": status.probe or "",
            "Alignment": status.alignment or "",
            "SoftwareRevision": status.version,
            "ArmFile": status.model or "",
        }
        when = _date(status.time_ns)
        # That nothing arrives is known here; all else is what it said last.
        for name, kind in _STATE_FIELDS.items():
            is_known = not absence or name in ("Online", "State")
            code = _GOOD if is_known else _LAST_KNOWN
            value = ua.Variant(values[name], kind)
            await self._write(self._state[name], value, code, when)
        lists = {
            "Alarms": [
                printable(f"{alarm.source}: {alarm.text}; {alarm.remedy}")
                for alarm in status.alarms
            ],
            "Devices": [
                printable(f"{device.id} ({device.driver}): {device.state}")
                for device in status.drivers
            ],
        }
        for name, texts in lists.items():
            value = ua.Variant(texts, _TEXT, is_array=True)
            code = _GOOD if status.online else _AWAY
            await self._write(self._state[name], value, code, when)

    async def _write_all(
        self,
        nodes: Mapping[str, Node],
        kinds: Mapping[str, ua.VariantType],
        values: Mapping[str, Any],
        code: ua.StatusCode,
        when: ua.DateTime,
    ) -> None:
        for name, kind in kinds.items():
            value = values[name]
            unknown = isinstance(value, float) and math.isnan(value)
            value_code = _UNKNOWN if unknown and not code.is_bad() else code
            await self._write(nodes[name], ua.Variant(value, kind), value_code, when)

    async def _write(
        self,
        node: Node,
        value: ua.Variant,
        code: ua.StatusCode,
        when: ua.DateTime | None = None,
    ) -> None:
        data = ua.DataValue(
            Value=value,
            StatusCode=code,
            SourceTimestamp=when,
            ServerTimestamp=ua.DateTime.now(UTC),
        )
        await self._server.write_attribute_value(node.nodeid, data)


def _code(quality: Quality) -> ua.StatusCode:
    return _GOOD if quality.ok else _UNCERTAIN


def _date(time_ns: int) -> ua.DateTime:
    return EPOCH + timedelta(microseconds=time_ns // 1000)


def _expanded_mm(covariance_mm2: Covariance | None) -> tuple[float, ...]:
    """U of x, y and z with k = 2; not a number where it is unknown."""
    if covariance_mm2 is None:
        return (math.nan,) * 3
    return tuple(COVERAGE * math.sqrt(covariance_mm2[place]) for place in (0, 3, 5))


def _pose_values(message: Live | Point) -> dict[str, Any]:
    lengths = (
        *message.xyz_mm,
        *_expanded_mm(message.covariance_mm2),
        *(message.part_xyz_mm or (math.nan,) * 3),
        message.probe_radius_mm,
    )
    doubts = ", ".join(message.quality.flags)
    return {**dict(zip(_LENGTHS, lengths, strict=True)), "Doubts": doubts}


def _point_values(point: Point) -> dict[str, Any]:
    return {
        **_pose_values(point),
        "Id": point.id,
        "Session": point.session,
        "Sequence": point.seq,
        "Artefact": point.label.artefact or "",
        "Feature": point.label.feature or "",
        "Retracts": point.retracts or "",
    }
