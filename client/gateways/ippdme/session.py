"""A client's session of I++ DME: no sockets, no tasks.

Numbers in parentheses are sections of the specification, version 1.4.3.
"""

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Literal

import numpy as np

from traverse.arrays import Floats
from traverse.client.gateways.alarms import alarm_of
from traverse.client.gateways.ippdme import tools
from traverse.client.gateways.ippdme.grammar import (
    ERRORS,
    SERVER_TAG,
    Argument,
    Command,
    IppError,
    Property,
    Word,
    error_line,
    parse,
    property_text,
    quoted,
)
from traverse.client.gateways.ippdme.machine import (
    AXES,
    Machine,
    shown,
    word,
)
from traverse.client.points.session_order import Lost
from traverse.protocol.messages import Live, Point, Status

VERSION = "1.4.3"
MAX_PENDING = 1000
MAX_DETAILS = 64
MAX_IDS = 10_000  # a point that was taken back is looked for among the latest
MIN_REPORT_S = 0.1  # at most ten movements a second are reported (6.3.2.7)
WHILE_LOCKED = ("GetErrStatusE", "GetXtdErrStatus", "ClearAllErrors", "EndSession")
"""What is carried out in a state of error. `EndSession`, since a client that sends it
and `StartSession` has a session in any case (6.3.1)."""
OF_THE_WAY = ("broker.lost",)  # the points that it has held up are good
WITHOUT_SESSION = ("StartSession", "EndSession")
N_NUMBERS = {"X": 1, "Y": 1, "Z": 1, "IJK": 3}

Lines = Sequence[str]
WAITS: Lines = ("",)
"""Returned by commands that end later, with `_complete`."""


Work = Callable[["Session", Command], Lines | None]


def _of_machine(work: Callable[[Machine, Sequence[Argument]], Lines | None]) -> Work:
    return lambda session, command: work(session.machine, command.args)


@dataclass(slots=True)
class MoveReport:
    """The daemon that reports movements (6.3.2.7)."""

    tag: str
    period_s: float | None
    distance_mm: float | None
    names: Sequence[str]
    at_s: float = -np.inf
    place_mm: Floats | None = None
    is_due: bool = False
    in_doubt: bool = False

    def is_wanted(self, place_mm: Floats, now_s: float) -> bool:
        """Return whether this pose is reported."""
        since_s = now_s - self.at_s
        far = self.distance_mm is not None and (
            self.place_mm is None
            or np.linalg.norm(place_mm - self.place_mm) > self.distance_mm
        )
        late = self.period_s is not None and since_s >= self.period_s
        return since_s >= MIN_REPORT_S and bool(far or late or self.is_due)


@dataclass(frozen=True, slots=True)
class Options:
    """The user's choices.

    Attributes:
        near_mm: greatest distance of a touch from its target for `PtMeas`; the ball's
            radius is added.
        radii_mm: radii of balls by tool, as far as known.
        keys: names of keys by input, such as "base/1".
    """

    near_mm: float = 10.0
    radii_mm: Mapping[str, float] = field(default_factory=dict)
    keys: Mapping[str, str] = field(default_factory=dict)
    machine_class: Literal["CartCMM", '"CartCMM"'] = "CartCMM"


class Session:
    """A client's session; transformations and tool outlive it (6.3.1.2).

    Args:
        send: takes lines for the client, without their ends.
        report: takes messages for people.
        change_probe: begins to change the probe; `tool_changed` or `tool_refused`
            ends it.
        clock: monotonic time [s].
    """

    def __init__(
        self,
        options: Options,
        send: Callable[[str], None],
        report: Callable[[str], None],
        change_probe: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._options = options
        self._send, self._report, self._change_probe = send, report, change_probe
        self.machine = Machine(options.radii_mm, clock)
        self._tools = self.machine.tools
        self._status: Status | None = None  # the last one while the arm was online
        self._pending: deque[Command] = deque()
        self._current: Command | None = None
        self._target: tuple[Floats, int] | None = None  # and touched after [ns]
        self._new_tool = self._new_model = ""
        self._radius_mm: float | None = None  # as the client knows it
        self._is_radius_new = False
        self._details: deque[IppError] = deque(maxlen=MAX_DETAILS)
        self._sent_ids: dict[str, None] = {}
        self._end()

    # What arrives from the client

    def take_line(self, line: bytes) -> None:
        """Take a line with its end."""
        try:
            command = parse(line)
        except IppError as error:
            if error.tag == SERVER_TAG:
                self._unsolicited("Parser", error)
            else:
                self._send(f"{error.tag} &")
                self._fail(Command(error.tag, "Parser"), error)
            return
        self._send(f"{command.tag} &")
        busy = self._unfinished()
        if any(command.tag == other.tag for other in busy):
            self._fail(command, IppError(1, f"{command.tag} is in use"))
        elif len(busy) > MAX_PENDING:
            self._fail(command, IppError(0, f"{MAX_PENDING} commands wait already"))
        elif command.is_fast or command.name == "AbortE":
            self._execute(command)
        else:
            self._pending.append(command)
            self._proceed()

    def disconnected(self) -> None:
        """End the session and its requests: the client has gone."""
        self._pending.clear()
        self._current = self._target = None
        self._end()

    # What arrives from the arm

    def take_status(self, status: Status, *, is_connected: bool) -> None:
        """Take the arm's state; any number of times."""
        machine, reachable = self.machine, status.online and is_connected
        if machine.is_reachable and not reachable and self._in_session:
            why = (
                "the arm is offline" if is_connected else "no connection to the broker"
            )
            self._unsolicited("Server", IppError(503, why, 1))
        machine.is_reachable = reachable
        if not status.online:
            return
        before, self._status = self._status, status
        alarm, machine.alarm = machine.alarm, alarm_of(status, ignored=OF_THE_WAY)
        if machine.alarm and machine.alarm != alarm and self._in_session:
            self._unsolicited("Server", IppError(1000, machine.alarm, 1))
        self._tools.library = status.probes or ()
        name = status.probe or tools.OWN
        is_new = before is None or before.probe != status.probe
        if is_new and name not in (self._tools.active, self._new_tool):
            self._activate(name)
            self._is_radius_new = self._event(
                property_text("ChangeTool", name), always=True
            )

    def take_live(self, live: Live) -> None:
        """Take the arm's latest pose."""
        self.machine.take_live(live)
        if self._new_tool and live.model == self._new_model:
            self._activate(self._new_tool)
            self._new_tool = self._new_model = ""
            self._radius_mm = live.probe_radius_mm
            self._tools.radii_mm[self._tools.active] = self._radius_mm
            self._end_tool_change("")
        self._note_radius(live.probe_radius_mm)
        if self._moves is not None:
            self._report_move(self._moves, live)

    def take_point(self, point: Point) -> None:
        """Take a point, or a retraction."""
        what, command = f"point {point.seq}", self._current
        if point.retracts is not None:
            self._take_back(point.retracts)
        elif not self._in_session:
            self._report(f"{what} not sent: there is no session")
        elif self._target is not None and command is not None:
            target_mm, since_ns = self._target  # nothing selects a system meanwhile
            place_mm = self.machine.systems.point(point.xyz_mm)
            off_mm = float(np.linalg.norm(place_mm - target_mm))
            if point.time_ns <= since_ns:
                self._report(f"{what} not sent: it was taken before PtMeas")
            elif off_mm > self._options.near_mm + point.probe_radius_mm:
                why = f"{what} is {off_mm:.1f} mm from the target; PtMeas goes on"
                self._error(command.tag, "PtMeas", IppError(1001, why, 1))
            else:
                result = self._measured(point)
                if isinstance(result, str):
                    self._note_sent(point)
                self._complete(result)
        elif not self._user:
            self._report(f"{what} not sent: the client has not enabled the user")
        elif isinstance(result := self._measured(point), IppError):
            result.severity = 1  # the operator repeats it; nothing is locked
            self._unsolicited("PtMeas", result)
        else:
            self._event(f"PtMeas({result})")
            self._note_sent(point)

    def take_loss(self, lost: Lost) -> None:
        """Take the loss of points."""
        error = IppError(511, f"points {lost.from_seq} to {lost.to_seq} are lost", 1)
        if self._in_session:
            self._unsolicited("PtMeas", error)

    def press(self, source: str) -> None:
        """Take an input that became active."""
        if source in self._options.keys:
            self._event(property_text("KeyPress", self._options.keys[source]))

    def tool_changed(self, model: str) -> None:
        """Take a change of probe: poses count from the first of this model."""
        self._new_model = model

    def tool_refused(self, error: IppError) -> None:
        """Take a refused change of probe."""
        self._new_tool = ""
        self._end_tool_change(error)

    # Transactions

    def _unfinished(self) -> list[Command]:
        return [*([] if self._current is None else [self._current]), *self._pending]

    def _proceed(self) -> None:
        while self._current is None and self._pending:
            self._current = self._pending.popleft()
            self._execute(self._current)

    def _execute(self, command: Command) -> None:
        try:
            data = self._result(command)
        except IppError as error:
            self._fail(command, error)
        else:
            if data is not WAITS:
                self._done(command, data or ())

    def _result(self, command: Command) -> Lines | None:
        """Return lines of data, if any, or `WAITS`."""
        name = command.name
        if not self._in_session and name not in WITHOUT_SESSION:
            raise IppError(8, "StartSession comes first")
        if self._is_locked and name not in WHILE_LOCKED:
            raise IppError(514)
        if name not in self._COMMANDS:
            raise IppError(501, f"{name} is no command of an arm")
        # A daemon is stopped by the tag of an event.
        if command.is_fast > name.endswith("E") or (
            name == "OnMoveReportE" and not command.is_fast
        ):
            raise IppError(1, f"{name} is not of the queue of {command.tag}")
        work, takes = self._COMMANDS[name]
        if takes is not None and len(command.args) != takes:
            raise IppError(
                502, f"{name} has {takes} arguments, not {len(command.args)}"
            )
        return work(self, command)

    def _done(self, command: Command, data: Lines) -> None:
        for line in data:
            self._send(f"{command.tag} # {line}")
        self._close(command)

    def _close(self, command: Command) -> None:
        self._send(f"{command.tag} %")
        if command is self._current:
            self._current = self._target = None

    def _fail(self, command: Command, error: IppError) -> None:
        """Answer with an error; from severity 2 on pending commands are aborted.

        Older commands of the slow queue are answered first (6.2.3).
        """
        aborts = error.severity > 1 and self._in_session
        if aborts and not command.is_fast and command is not self._current:
            self._abort()
        self._error(command.tag, command.name, error)
        self._close(command)
        if aborts:
            self._abort()

    def _abort(self, _: Command | None = None) -> None:
        self._is_locked = True
        left = self._unfinished()
        self._pending.clear()
        for command in left:
            self._error(command.tag, command.name, IppError(6))
            self._close(command)

    def _complete(self, result: IppError | str) -> None:
        """End the waiting command, and continue with the next."""
        if self._current is not None:
            if isinstance(result, IppError):
                self._fail(self._current, result)
            else:
                self._done(self._current, [result] if result else [])
        self._proceed()

    def _error(self, tag: str, method: str, error: IppError) -> None:
        self._send(error_line(tag, method, error))
        if error.why:
            self._details.append(error)
            self._report(f"{tag} {method}: {error}")

    def _unsolicited(self, method: str, error: IppError) -> None:
        self._error(SERVER_TAG, method, error)
        if error.severity > 1 and self._in_session:
            self._abort()

    def _event(self, data: str, *, always: bool = False) -> bool:
        """Send an event of the server, while the user is enabled; whether it was."""
        is_sent = self._in_session and (self._user or always)
        if is_sent:
            self._send(f"{SERVER_TAG} # {data}")
        return is_sent

    def _end(self, _: Command | None = None) -> None:
        """Reset the session: nothing is requested, locked or enabled."""
        self._in_session = self._is_locked = self._user = False
        self._reported: tuple[str, ...] = AXES
        self._moves: MoveReport | None = None
        self._tools.found_tool = tools.UNDEFINED
        self._sent_ids.clear()
        self._details.clear()

    def _note_radius(self, radius_mm: float) -> None:
        """Announce a radius that differs from the one sent before."""
        if self._tools.active == tools.NONE or self._new_tool:
            return
        before, self._radius_mm = self._radius_mm, radius_mm
        self._tools.radii_mm[self._tools.active] = radius_mm
        if self._is_radius_new or before not in (None, radius_mm):
            radius = property_text("Tool.AvrRadius", radius_mm)
            self._event(f"SetProp({radius})", always=True)
        self._is_radius_new = False

    def _measured(self, point: Point) -> str | IppError:
        """Return the data of a point, or an error if it is in doubt."""
        self._note_radius(point.probe_radius_mm)
        try:
            self.machine.require_good(point, f"point {point.seq}")
            return self.machine.values(self._reported, point)
        except IppError as error:
            return error

    def _note_sent(self, point: Point) -> None:
        self._sent_ids[point.id] = None
        if len(self._sent_ids) > MAX_IDS:
            del self._sent_ids[next(iter(self._sent_ids))]

    def _take_back(self, point_id: str) -> None:
        if point_id not in self._sent_ids:
            return
        del self._sent_ids[point_id]
        if not self._event(property_text("KeyPress", "Del")):
            # No key may be sent now, and the client holds the point for good.
            why = f"{point_id} was sent, and is taken back"
            self._unsolicited("Undo", IppError(1001, why))

    def _report_move(self, moves: MoveReport, live: Live) -> None:
        was_in_doubt, moves.in_doubt = moves.in_doubt, True
        try:
            self.machine.require_good(live, "the pose")
            data = self.machine.values(moves.names, live)
        except IppError as error:
            if not was_in_doubt:
                error.severity = 1
                self._error(moves.tag, "OnMoveReportE", error)
            return
        moves.in_doubt = False
        place, now_s = np.array(live.xyz_mm), self.machine.live_s
        if moves.is_wanted(place, now_s):
            self._send(f"{moves.tag} # {data}")
            moves.at_s, moves.place_mm, moves.is_due = now_s, place, False

    def _activate(self, name: str) -> None:
        self._tools.activate(name)
        self._moved_virtually()

    def _moved_virtually(self) -> None:
        if self._moves is not None:
            self._moves.is_due = True

    def _end_tool_change(self, result: IppError | str) -> None:
        if self._current is not None and self._current.name in (
            "ChangeTool",
            "SetTool",
        ):
            self._complete(result)

    # Commands

    def _start_session(self, _: Command) -> None:
        if self._in_session:
            raise IppError(8, "a session has been started already")
        self._end()
        self._in_session = True

    def _stop_daemon(self, command: Command) -> None:
        running = None if self._moves is None else Word(self._moves.tag)
        if command.args and command.args[0] != running:
            raise IppError(513, shown(command.args[0]))
        if running is None:
            raise IppError(512, "there is none")
        self._moves = None

    def _clear_all_errors(self, _: Command) -> None:
        self._is_locked = False
        self._details.clear()

    def _says(self, command: Command) -> Lines:
        said = {
            "GetDMEVersion": f'DMEVersion("{VERSION}")',
            "GetErrStatusE": f"ErrStatus({int(self._is_locked)})",
            "IsHomed": "IsHomed(1)",
            "IsUserEnabled": f"IsUserEnabled({int(self._user)})",
            "GetMachineClass": f"GetMachineClass({self._options.machine_class})",
        }
        return (said[command.name],)

    def _error_info(self, command: Command) -> Lines:
        (wanted,) = command.args
        if not isinstance(wanted, float) or wanted not in ERRORS:
            raise IppError(509, f"{shown(wanted)} is no number of an error here")
        return (quoted(ERRORS[int(wanted)][1]),)

    def _set_user(self, command: Command) -> None:
        self._user = command.name == "EnableUser"

    def _extended_status(self, _: Command) -> Lines:
        alarms = self._status.alarms if self._status else ()
        texts = [(f"{e.number:04d}", f"{e.text}: {e.why}") for e in self._details]
        texts += [(alarm.code, alarm.text) for alarm in alarms]
        return (
            "IsHomed(1)",
            f"IsUserEnabled({int(self._user)})",
            *(f"{quoted(code)},{quoted(text)}" for code, text in texts),
        )

    def _go_to(self, _: Command) -> None:
        raise IppError(1011, "an arm is led by hand")

    def _on_point(self, command: Command) -> None:
        self._reported = self.machine.enumerated(command.args, of_point=True)

    def _on_move(self, command: Command) -> None:
        if self._moves is not None:
            raise IppError(515, f"{self._moves.tag}: stop it first")
        limits: dict[str, float] = {}
        rest: list[Argument] = []
        for arg in command.args:
            if not isinstance(arg, Property) or arg.name not in (
                "Time",
                "Dis",
            ):
                rest.append(arg)
            elif len(arg.values) != 1 or arg.name in limits or arg.values[0] < 0.0:
                raise IppError(509, f"{shown(arg)}: expected one number above 0, once")
            else:
                limits[arg.name] = arg.values[0]
        if not limits:
            raise IppError(502, "Time or Dis is missing")
        names = self.machine.enumerated(rest)
        period_s = limits.get("Time")
        is_short = period_s is not None and period_s < MIN_REPORT_S
        self._moves = MoveReport(
            command.tag,
            MIN_REPORT_S if is_short else period_s,
            limits.get("Dis"),
            names,
        )
        if is_short:
            raise IppError(504, f"Time is {MIN_REPORT_S:g} s at least, which is used")

    def _pt_meas(self, command: Command) -> Lines:
        """Wait for the operator's touch near the target."""
        given: dict[str, tuple[float, ...]] = {}
        for arg in command.args:
            if (
                not isinstance(arg, Property)
                or arg.name in given
                or len(arg.values) != N_NUMBERS.get(arg.name)
            ):
                raise IppError(
                    509, f"{shown(arg)}: expected X(x), Y(y), Z(z), IJK(i,j,k)"
                )
            given[arg.name] = arg.values
        if given.keys() <= {"IJK"}:
            raise IppError(509, "X, Y or Z is missing")
        if not any(given.get("IJK", (1.0,))):
            raise IppError(1010, "IJK(0,0,0)")
        self.machine.require_probe()
        pose, systems = self.machine.pose(), self.machine.systems
        place = systems.point(pose.xyz_mm)
        values = [given.get(axis, (place[i],))[0] for i, axis in enumerate(AXES)]
        self._user = False
        self._target = (np.array(values), pose.time_ns)
        return WAITS

    def _change_tool(self, command: Command) -> Lines | None:
        name = self._tools.require(command.args[0])
        if self._new_tool:
            raise IppError(508, f"the change to {self._new_tool} has not ended")
        probe = (self._status.probe if self._status else None) or tools.OWN
        self._user = False
        if name in (tools.NONE, probe):
            self._activate(name)
            return None
        if name == tools.OWN:
            raise IppError(1502, f"only a restart of the arm goes back to {tools.OWN}")
        self._new_tool = name
        self._change_probe(name)
        return WAITS

    def _select_system(self, command: Command) -> None:
        self.machine.systems.select(word(command.args[0]))
        self._moved_virtually()

    _COMMANDS: ClassVar[Mapping[str, tuple[Work, int | None]]] = {
        "StartSession": (_start_session, 0),
        "EndSession": (_end, 0),
        "GetDMEVersion": (_says, 0),
        "AbortE": (_abort, 0),
        "ClearAllErrors": (_clear_all_errors, 0),
        "GetErrorInfo": (_error_info, 1),
        "GetErrStatusE": (_says, 0),
        "GetXtdErrStatus": (_extended_status, 0),
        "StopDaemon": (_stop_daemon, 1),
        "StopAllDaemons": (_stop_daemon, 0),
        "Home": (_set_user, 0),
        "IsHomed": (_says, 0),
        "EnableUser": (_set_user, 0),
        "DisableUser": (_set_user, 0),
        "IsUserEnabled": (_says, 0),
        "OnPtMeasReport": (_on_point, None),
        "OnMoveReportE": (_on_move, None),
        "GetMachineClass": (_says, 0),
        "PtMeas": (_pt_meas, None),
        "GoTo": (_go_to, None),
        "ChangeTool": (_change_tool, 1),
        "SetTool": (_change_tool, 1),
        "SetCoordSystem": (_select_system, 1),
        **{
            name: (_of_machine(work), takes)
            for name, (work, takes) in Machine.COMMANDS.items()
        },
    }
    """Method, and number of arguments; None: several."""
