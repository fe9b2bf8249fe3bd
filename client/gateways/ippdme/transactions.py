"""Pending commands of a client: two queues, answers, errors (6.2, 8).

The fast queue overtakes the slow one, whose commands run in order.
"""

from collections import deque
from collections.abc import Callable, Sequence

from traverse.client.gateways.ippdme.grammar import (
    SERVER_TAG,
    Command,
    IppError,
    error_line,
    parse,
)

MAX_PENDING = 1000
MAX_DETAILS = 64

Lines = Sequence[str]
WAITS: Lines = ("",)
"""Returned by commands that end later, with `Transactions.complete`."""


class Transactions:
    """Answer each command with `&`, then data or errors, then `%`.

    Args:
        result: carries a command out, and returns lines of data, if any, or `WAITS`;
            raises `IppError`.
        send: takes lines for the client, without their ends.

    Attributes:
        current: the command of the slow queue that waits for its end.
        in_session: errors of severity 2 lock a session, and nothing else.
        details: the latest errors that have a reason.
    """

    def __init__(
        self,
        result: Callable[[Command], Lines | None],
        send: Callable[[str], None],
        report: Callable[[str], None],
    ) -> None:
        self._result, self._send, self._report = result, send, report
        self._pending: deque[Command] = deque()
        self.current: Command | None = None
        self.in_session = self.is_locked = False
        self.details: deque[IppError] = deque(maxlen=MAX_DETAILS)

    def begin(self, *, in_session: bool) -> None:
        """Begin a session, or a time without one: nothing is locked."""
        self.in_session = in_session
        self.unlock()

    def unlock(self) -> None:
        self.is_locked = False
        self.details.clear()

    def clear(self) -> None:
        """Forget all commands unanswered: the client has gone."""
        self._pending.clear()
        self.current = None

    def take_line(self, line: bytes) -> None:
        try:
            command = parse(line)
        except IppError as error:
            if error.tag == SERVER_TAG:
                self.report_unsolicited("Parser", error)
            else:
                self._send(f"{error.tag} &")
                self._fail(Command(error.tag, "Parser"), error)
            return
        self._send(f"{command.tag} &")
        busy = self._unfinished()
        if any(command.tag == transaction.tag for transaction in busy):
            self._fail(command, IppError(1, f"{command.tag} is in use"))
        elif len(busy) > MAX_PENDING:
            self._fail(command, IppError(0, f"{MAX_PENDING} commands wait already"))
        elif command.is_fast or command.name == "AbortE":
            self._execute(command)
        else:
            self._pending.append(command)
            self._proceed()

    def complete(self, result: IppError | str) -> None:
        """End the waiting command, and continue with the next."""
        if self.current is not None:
            if isinstance(result, IppError):
                self._fail(self.current, result)
            else:
                self._answer(self.current, [result] if result else [])
        self._proceed()

    def abort(self) -> None:
        """Lock the session, and end all its commands with an error."""
        self.is_locked = True
        left = self._unfinished()
        self._pending.clear()
        for command in left:
            self.report_error(command.tag, command.name, IppError(6))
            self._close(command)

    def report_error(self, tag: str, method: str, error: IppError) -> None:
        self._send(error_line(tag, method, error))
        if error.why:
            self.details.append(error)
            self._report(f"{tag} {method}: {error}")

    def report_unsolicited(self, method: str, error: IppError) -> None:
        self.report_error(SERVER_TAG, method, error)
        if error.severity > 1 and self.in_session:
            self.abort()

    def _unfinished(self) -> list[Command]:
        return [*([] if self.current is None else [self.current]), *self._pending]

    def _proceed(self) -> None:
        while self.current is None and self._pending:
            self.current = self._pending.popleft()
            self._execute(self.current)

    def _execute(self, command: Command) -> None:
        try:
            data = self._result(command)
        except IppError as error:
            self._fail(command, error)
        else:
            if data is not WAITS:
                self._answer(command, data or ())

    def _answer(self, command: Command, data: Lines) -> None:
        for line in data:
            self._send(f"{command.tag} # {line}")
        self._close(command)

    def _close(self, command: Command) -> None:
        self._send(f"{command.tag} %")
        if command is self.current:
            self.current = None

    def _fail(self, command: Command, error: IppError) -> None:
        """Answer with an error; from severity 2 on pending commands are aborted.

        Older commands of the slow queue are answered first (6.2.3).
        """
        aborts = error.severity > 1 and self.in_session
        if aborts and not command.is_fast and command is not self.current:
            self.abort()
        self.report_error(command.tag, command.name, error)
        self._close(command)
        if aborts:
            self.abort()
