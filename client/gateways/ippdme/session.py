"""A client's session of I++ DME: no sockets, no tasks.

Numbers in parentheses are sections of the specification, version 1.4.3.
"""

import time
from collections.abc import Callable, Mapping
from typing import ClassVar

import numpy as np

from traverse.arrays import Floats
from traverse.client.gateways.alarms import alarm_of
from traverse.client.gateways.ippdme import tools
from traverse.client.gateways.ippdme.grammar import (
    ERRORS,
    SERVER_TAG,
    Command,
    IppError,
    Word,
    property_text,
    quoted,
)
from traverse.client.gateways.ippdme.machine import (
    AXES,
    Args,
    Machine,
    shown,
    target_values,
    word,
)
from traverse.client.gateways.ippdme.move_report import MoveReport, requested_report
from traverse.client.gateways.ippdme.options import Options
from traverse.client.gateways.ippdme.transactions import WAITS, Lines, Transactions
from traverse.client.points.doubts import SentPoints
from traverse.client.points.session_order import Lost
from traverse.protocol.messages import Live, Point, Status
from traverse.protocol.messages.later_doubt import LaterDoubt

VERSION = "1.4.3"
WHILE_LOCKED = ("GetErrStatusE", "GetXtdErrStatus", "ClearAllErrors", "EndSession")
"""What is carried out in a state of error. `EndSession`, since a client that sends it
and `StartSession` has a session in any case (6.3.1)."""
OF_THE_WAY = ("broker.lost",)  # the points that it has held up are good
WITHOUT_SESSION = ("StartSession", "EndSession")
Work = Callable[["Session", Command], Lines | None]


def _of_machine(work: Callable[[Machine, Args], Lines | None]) -> Work:
    return lambda session, command: work(session.machine, command.args)


class Session:
    """A client's session; transformations and tool outlive it (6.3.1.2).

    Args:
        send: takes lines for the client, without their ends.
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
        self._transactions = Transactions(self._result, send, report)
        self.take_line = self._transactions.take_line
        # Of PtMeas: the place, and that it is touched after [ns].
        self._target: tuple[Floats, int] = np.zeros(3), 0
        self._new_tool = self._new_model = ""
        self._radius_mm: float | None = None  # as the client knows it
        self._is_radius_new = False
        self._sent = SentPoints()
        self._end()

    def disconnected(self) -> None:
        self._transactions.clear()
        self._end()

    # What arrives from the arm

    def take_status(self, status: Status, absence: str = "") -> None:
        """Take the arm's state; any number of times.

        Args:
            status: of the arm.
            absence: why nothing is known of it; else empty.
        """
        machine, reachable = self.machine, status.online and not absence
        if machine.is_reachable and not reachable and self._transactions.in_session:
            why = absence or "the arm is offline"
            self._transactions.report_unsolicited("Server", IppError(503, why, 1))
        machine.is_reachable = reachable
        if not status.online:
            return
        before, self._status = self._status, status
        alarm, machine.alarm = machine.alarm, alarm_of(status, ignored=OF_THE_WAY)
        if machine.alarm and machine.alarm != alarm and self._transactions.in_session:
            self._transactions.report_unsolicited(
                "Server", IppError(1000, machine.alarm, 1)
            )
        self._tools.library = status.probes or ()
        name = status.probe or tools.OWN
        is_new = before is None or before.probe != status.probe
        if is_new and name not in (self._tools.active, self._new_tool):
            self._activate(name)
            self._is_radius_new = self._event(
                property_text("ChangeTool", name), always=True
            )

    def take_live(self, live: Live) -> None:
        self.machine.take_live(live)
        if self._new_tool and live.model == self._new_model:
            self._activate(self._new_tool)
            self._new_tool = self._new_model = ""
            self._radius_mm = live.probe_radius_mm
            self._tools.radii_mm[self._tools.active] = self._radius_mm
            self._end_tool_change("")
        self._note_radius(live.probe_radius_mm)
        if self._moves is not None:
            try:
                if data := self._moves.line(live, self.machine):
                    self._send(data)
            except IppError as error:
                error.severity = 1
                self._transactions.report_error(self._moves.tag, "OnMoveReportE", error)

    def take_point(self, point: Point) -> None:
        label, command = f"point {point.seq}", self._transactions.current
        if point.retracts is not None:
            self._take_back(point.retracts)
        elif not self._transactions.in_session:
            self._report(f"{label} not sent: there is no session")
        elif command is not None and command.name == "PtMeas":
            target_mm, since_ns = self._target  # nothing selects a system meanwhile
            place_mm = self.machine.systems.point(point.xyz_mm)
            off_mm = float(np.linalg.norm(place_mm - target_mm))
            if point.time_ns <= since_ns:
                self._report(f"{label} not sent: it was taken before PtMeas")
            elif off_mm > self._options.near_mm + point.probe_radius_mm:
                why = f"{label} is {off_mm:.1f} mm from the target; PtMeas goes on"
                self._transactions.report_error(
                    command.tag, "PtMeas", IppError(1001, why, 1)
                )
            else:
                result = self._measured(point)
                if isinstance(result, str):
                    self._sent.add(point)
                self._transactions.complete(result)
        elif not self._user:
            self._report(f"{label} not sent: the client has not enabled the user")
        elif isinstance(result := self._measured(point), IppError):
            result.severity = 1  # the operator repeats it; nothing is locked
            self._transactions.report_unsolicited("PtMeas", result)
        else:
            self._event(f"PtMeas({result})")
            self._sent.add(point)

    def take_loss(self, lost: Lost) -> None:
        error = IppError(511, f"points {lost.from_seq} to {lost.to_seq} are lost", 1)
        if self._transactions.in_session:
            self._transactions.report_unsolicited("PtMeas", error)

    def press(self, source: str) -> None:
        if source in self._options.keys:
            self._event(property_text("KeyPress", self._options.keys[source]))

    def tool_changed(self, model: str) -> None:
        """Take a change of probe: poses count from the first of this model."""
        self._new_model = model

    def tool_refused(self, error: IppError) -> None:
        self._new_tool = ""
        self._end_tool_change(error)

    # Commands and events

    def _result(self, command: Command) -> Lines | None:
        name = command.name
        if not self._transactions.in_session and name not in WITHOUT_SESSION:
            raise IppError(8, "StartSession comes first")
        if self._transactions.is_locked and name not in WHILE_LOCKED:
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

    def _event(self, data: str, *, always: bool = False) -> bool:
        """Send an event of the server, while the user is enabled; whether it was."""
        is_sent = self._transactions.in_session and (self._user or always)
        if is_sent:
            self._send(f"{SERVER_TAG} # {data}")
        return is_sent

    def _end(self, _: Command | None = None) -> None:
        """Reset the session: nothing is requested, locked or enabled."""
        self._transactions.begin(in_session=False)
        self._user = False
        self._reported: tuple[str, ...] = AXES
        self._moves: MoveReport | None = None
        self._tools.found_tool = tools.UNDEFINED
        self._sent = SentPoints()

    def _note_radius(self, radius_mm: float) -> None:
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

    def _take_back(self, point_id: str) -> None:
        if self._sent.by_id.pop(point_id, None) is None:
            return
        if not self._event(property_text("KeyPress", "Del")):
            # No key may be sent now, and the client holds the point for good.
            why = f"{point_id} was sent, and is taken back"
            self._transactions.report_unsolicited("Undo", IppError(1001, why))

    def take_doubt(self, doubt: LaterDoubt) -> None:
        """Say of which points that the client has it has become known."""
        for point in self._sent.doubt(doubt):
            flags = ", ".join(point.quality.flags)
            why = f"point {point.seq} was sent, and is in doubt ({flags})"
            self._transactions.report_unsolicited("PtMeas", IppError(1001, why))

    def _activate(self, name: str) -> None:
        self._tools.activate(name)
        self._moved_virtually()

    def _moved_virtually(self) -> None:
        if self._moves is not None:
            self._moves.is_due = True

    def _end_tool_change(self, result: IppError | str) -> None:
        command = self._transactions.current
        if command is not None and command.name in ("ChangeTool", "SetTool"):
            self._transactions.complete(result)

    def _start_session(self, _: Command) -> None:
        if self._transactions.in_session:
            raise IppError(8, "a session has been started already")
        self._end()
        self._transactions.begin(in_session=True)

    def _stop_daemon(self, command: Command) -> None:
        running = None if self._moves is None else Word(self._moves.tag)
        if command.args and command.args[0] != running:
            raise IppError(513, shown(command.args[0]))
        if running is None:
            raise IppError(512, "there is none")
        self._moves = None

    def _clear_all_errors(self, _: Command) -> None:
        self._transactions.unlock()

    def _abort(self, _: Command) -> None:
        self._transactions.abort()

    def _says(self, command: Command) -> Lines:
        answers = {
            "GetDMEVersion": f'DMEVersion("{VERSION}")',
            "GetErrStatusE": f"ErrStatus({int(self._transactions.is_locked)})",
            "IsHomed": "IsHomed(1)",
            "IsUserEnabled": f"IsUserEnabled({int(self._user)})",
            "GetMachineClass": f"GetMachineClass({self._options.machine_class})",
        }
        return (answers[command.name],)

    def _error_info(self, command: Command) -> Lines:
        (number,) = command.args
        if not isinstance(number, float) or number not in ERRORS:
            raise IppError(509, f"{shown(number)} is no number of an error here")
        return (quoted(ERRORS[int(number)][1]),)

    def _set_user(self, command: Command) -> None:
        self._user = command.name == "EnableUser"

    def _extended_status(self, _: Command) -> Lines:
        alarms = self._status.alarms if self._status else ()
        texts = [
            (f"{e.number:04d}", f"{e.text}: {e.why}")
            for e in self._transactions.details
        ]
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
        self._moves = requested_report(command, self.machine)
        self._moves.warn_of_period()

    def _pt_meas(self, command: Command) -> Lines:
        """Wait for the operator's touch near the target."""
        targets = target_values(command.args)
        self.machine.require_probe()
        pose, systems = self.machine.pose(), self.machine.systems
        place = systems.point(pose.xyz_mm)
        values = [targets.get(axis, (place[i],))[0] for i, axis in enumerate(AXES)]
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
