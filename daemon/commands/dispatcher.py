"""Dispatch of commands: validated, executed once for each request, always answered.

A repeated `request` gets the first answer. Retained commands are ignored; late ones are
refused (`daemon/commands/expiry.py`). Commands beyond the limits are answered so, or
dropped and counted; see docs/security.md.
"""

import asyncio
import logging
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from dataclasses import InitVar, dataclass
from typing import Any

from traverse.daemon.clock import HostClock
from traverse.daemon.commands.expiry import Arrival, CommandExpiry
from traverse.daemon.commands.rate_limit import (
    PAUSE_S,
    CommandRateLimiter,
    RefusalLog,
    single_line,
)
from traverse.daemon.current_request import CURRENT_REQUEST
from traverse.daemon.errors import RequestRefusedError, Result
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage
from traverse.daemon.mqtt.subscriber import IncomingCommand
from traverse.protocol.encoding import Encoding, decode, encode, parse_args
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import COMMANDS, Command, Reply, ReplyError
from traverse.protocol.topics import is_response_topic, parse_topic, reply_topic

log = logging.getLogger(__name__)

MAX_RUNNING = 16
MAX_COMMAND_BYTES = 16_384
MAX_COMMAND_ELEMENTS = 256
MAX_CORRELATION_BYTES = 256
MAX_REMEMBERED = 256
MAX_REMEMBERED_BYTES = 4_194_304

CommandHandler = Callable[[Any], Awaitable[Result]]
Answer = asyncio.Future[bytes]


@dataclass(eq=False, kw_only=True)
class CommandDispatcher:
    """Receives commands and sends answers.

    Args:
        carry_out: handlers by command name, called with typed arguments.
        expiry: judges whether a command is too late.
        response_topics: filters of topics for answers, see [broker].
    """

    arm: str
    encoding: Encoding
    offer: Callable[[OutgoingMessage], bool]
    carry_out: Mapping[str, CommandHandler]
    events: EventLog
    expiry: CommandExpiry
    clock: InitVar[HostClock]
    response_topics: tuple[str, ...] = ()

    def __post_init__(self, clock: HostClock) -> None:
        self._limits = CommandRateLimiter(clock, self._tell_flood, self.carry_out)
        self._refusals = RefusalLog(clock)
        self._answers = ReplyCache()
        self._running: set[asyncio.Task[None]] = set()
        self.received = 0
        self.refused = 0

    def receive(self, incoming: IncomingCommand) -> float:
        """Process a command; its answer follows when it is known.

        Returns how long the broker should keep further commands [s], mostly 0.
        """
        self.received += 1
        topic = single_line(incoming.topic)
        if incoming.retained:  # no flood: it comes once with each subscription
            self._drop(
                "commands.retained",
                f"the broker keeps an old command on {topic}; ignored",
                "clear it: publish an empty retained message there",
            )
            return 0.0
        if not self._limits.admit():
            self.refused += 1
            return PAUSE_S if self._limits.is_flooded else 0.0
        if len(incoming.payload) > MAX_COMMAND_BYTES:
            self._drop(
                "commands.too_long",
                f"a command on {topic} has more than {MAX_COMMAND_BYTES} bytes; "
                "dropped without an answer",
                "find its sender; see max_packet_size of the broker",
            )
        elif len(self._running) >= 2 * MAX_RUNNING:  # with those who wait for answers
            self._refuse(f"too many commands at once, one on {incoming.topic} dropped")
        else:
            arrival = self.expiry.arrival(incoming)
            task = asyncio.create_task(self._answer(incoming, arrival))
            self._running.add(task)
            task.add_done_callback(self._running.discard)
        return 0.0

    def check_flood_end(self) -> None:
        """Report the end of a flood and unlogged refusals; call regularly."""
        self._limits.check_flood_end()
        self._refusals.write_rest()

    def remember(self, name: str, request: str, result: Result) -> None:
        """Store the result of an earlier run's request, for repetitions."""
        reply = Reply(request=request, ok=True, result=dict(result))
        self._answers.remember(name, request, encode(reply, self.encoding))

    async def close(self) -> None:
        tasks: list[asyncio.Future[Any]] = [*self._running, *self._answers.executing]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _answer(self, incoming: IncomingCommand, arrival: Arrival) -> None:
        try:
            name = parse_topic(incoming.topic).command or ""
            command = decode(
                Command, incoming.payload, max_elements=MAX_COMMAND_ELEMENTS
            )
        except MessageError as error:
            # Without an envelope there is no request to answer by.
            self._refuse(f"command on {incoming.topic} dropped: {error}")
            return
        topic, correlation = reply_topic(self.arm, name), None
        try:
            self._check_way_back(incoming)
            topic = incoming.response_topic or topic
            correlation = incoming.correlation
            task = self._answers.answers.get((name, command.request))
            if task is None:
                self._check_rate(name)  # the same request may be sent again later
                work = self._reply(name, command, arrival)
                task = self._answers.begin(name, command.request, work)
            payload = await asyncio.shield(task)
        except RequestRefusedError as problem:
            payload = self._refusal(name, command.request, problem)
        self.offer(OutgoingMessage(topic, payload, qos=1, correlation=correlation))

    async def _reply(self, name: str, command: Command, arrival: Arrival) -> bytes:
        CURRENT_REQUEST.set(command.request)  # of this task
        try:
            self.expiry.check(command.expires, arrival)
            carry_out = self.carry_out.get(name)
            if carry_out is None:
                known = name in COMMANDS
                lack = "this version cannot do" if known else "there is no command"
                raise RequestRefusedError(
                    "command.not_available",
                    f"{lack} {name!r}; it has: {', '.join(sorted(self.carry_out))}",
                    "use one of these commands",
                )
            result = await carry_out(parse_args(name, command.args))
            reply = Reply(request=command.request, ok=True, result=dict(result))
            return encode(reply, self.encoding)
        except MessageError as error:
            problem = RequestRefusedError(
                "command.bad_args", str(error), "correct the arguments and send again"
            )
        except RequestRefusedError as error:
            problem = error
        except Exception as error:
            log.exception("fault in command %s", name)
            problem = RequestRefusedError(
                "command.failed",
                f"a fault in the daemon: {type(error).__name__}; see its log",
                "report it with the daemon's log",
            )
        return self._refusal(name, command.request, problem)

    def _refusal(self, name: str, request: str, problem: RequestRefusedError) -> bytes:
        self._refuse(f"command {name} refused: {problem}")
        error = ReplyError(
            code=problem.code, text=str(problem)[:2000], remedy=problem.remedy
        )
        return encode(Reply(request=request, ok=False, error=error), self.encoding)

    def _check_way_back(self, incoming: IncomingCommand) -> None:
        """Check that the answer may go to the requested topic."""
        topic, correlation = incoming.response_topic, incoming.correlation
        if topic is not None and not is_response_topic(
            topic, self.arm, self.response_topics
        ):
            raise RequestRefusedError(
                "command.bad_response",
                f"answers do not go to {topic[:200]!r}; the command was not carried "
                f"out. Expected: a topic below traverse/{self.arm}/reply/",
                "leave the response topic out, or have it allowed by response_topics "
                "in [broker] of the daemon's configuration",
            )
        if correlation is not None and len(correlation) > MAX_CORRELATION_BYTES:
            raise RequestRefusedError(
                "command.bad_response",
                f"correlation data of {len(correlation)} bytes; the command was not "
                f"carried out. Expected: at most {MAX_CORRELATION_BYTES}",
                "use shorter correlation data",
            )

    def _check_rate(self, name: str) -> None:
        n_executing = len(self._answers.executing)
        if n_executing >= MAX_RUNNING or not self._limits.admit_kind(name):
            raise RequestRefusedError(
                "command.too_many",
                "too many commands in a short time, or still being executed; this one "
                "was not",
                "wait, and send it again with the same request",
            )

    def _refuse(self, text: str) -> None:
        """Count a refused command; senders cannot flood the log."""
        self.refused += 1
        self._refusals.write(text)

    def _drop(self, code: str, text: str, remedy: str) -> None:
        self.refused += 1
        self.events.report("warning", code, text, remedy=remedy)

    def _tell_flood(self, begins: bool, dropped: int) -> None:
        self.events.change(
            begins,
            "warning",
            "commands.flood",
            "commands arrive faster than they are processed; the rest is dropped"
            if begins
            else f"commands arrive at a normal rate again; {dropped} were dropped",
            remedy="find their sender; see the broker's access list" if begins else "",
            data={} if begins else {"dropped": dropped},
        )


class ReplyCache:
    """First answer to each request, by command name and request.

    Answers in `executing` are never evicted.
    """

    def __init__(self) -> None:
        self.answers: OrderedDict[tuple[str, str], Answer] = OrderedDict()
        self.executing: set[Answer] = set()
        self._bytes = 0

    def remember(self, name: str, request: str, payload: bytes) -> None:
        answer: Answer = asyncio.get_running_loop().create_future()
        answer.set_result(payload)
        self.answers[name, request] = answer
        self._ended(answer)

    def begin(
        self, name: str, request: str, work: Coroutine[Any, Any, bytes]
    ) -> Answer:
        task = asyncio.create_task(work)
        self.executing.add(task)
        self.answers[name, request] = task
        task.add_done_callback(self._ended)
        return task

    def _ended(self, task: Answer) -> None:
        self.executing.discard(task)
        self._bytes += _size(task)
        while len(self.answers) > MAX_REMEMBERED or self._bytes > MAX_REMEMBERED_BYTES:
            done = (key for key, reply in self.answers.items() if reply.done())
            oldest = next(done, None)
            if oldest is None:
                return
            self._bytes -= _size(self.answers.pop(oldest))


def _size(task: Answer) -> int:
    return 0 if task.cancelled() else len(task.result())
