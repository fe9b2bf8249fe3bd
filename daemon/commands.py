"""Commands from outside: checked, carried out once, answered always.

A command with the `request` of an earlier one is not carried out again: it gets the
first answer. Retained commands are ignored, since they say nothing about now.
"""

import asyncio
import logging
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from daemon.outgoing import Outgoing
from daemon.publisher import Incoming
from protocol.encoding import Encoding, decode, encode, parse_args
from protocol.message_error import MessageError
from protocol.messages import COMMANDS, Command, Reply, ReplyError
from protocol.topics import parse_topic, reply_topic

log = logging.getLogger(__name__)

MAX_REMEMBERED = 256
MAX_RUNNING = 16
MAX_COMMAND_BYTES = 16_384

Result = Mapping[str, Any]
CommandHandler = Callable[[Any], Awaitable[Result]]


class CommandError(Exception):
    """A command that cannot be carried out; the sender is told why."""

    def __init__(self, code: str, text: str, remedy: str) -> None:
        super().__init__(text)
        self.code = code
        self.remedy = remedy


class CommandDesk:
    """Takes commands in and sends answers out.

    Args:
        arm: name of the arm.
        encoding: of the answers.
        offer: hands an answer to the outgoing queue.
        carry_out: what carries out each command that this daemon has, by name;
            called with the command's typed arguments.
    """

    def __init__(
        self,
        *,
        arm: str,
        encoding: Encoding,
        offer: Callable[[Outgoing], bool],
        carry_out: Mapping[str, CommandHandler],
    ) -> None:
        self._arm = arm
        self._encoding = encoding
        self._offer = offer
        self._carry_out = carry_out
        self._answers: OrderedDict[tuple[str, str], asyncio.Task[Reply]] = OrderedDict()
        self._running: set[asyncio.Task[None]] = set()
        self.received = 0
        self.refused = 0

    def receive(self, incoming: Incoming) -> None:
        """A command has arrived; its answer follows when there is one."""
        self.received += 1
        if incoming.retained:
            log.warning("retained command on %s ignored", incoming.topic)
            return
        if len(self._running) >= MAX_RUNNING:
            self.refused += 1
            log.warning("too many commands at once, one on %s dropped", incoming.topic)
            return
        task = asyncio.create_task(self._answer(incoming))
        self._running.add(task)
        task.add_done_callback(self._running.discard)

    async def close(self) -> None:
        """Abandon what is still running."""
        tasks = [*self._running, *(t for t in self._answers.values() if not t.done())]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _answer(self, incoming: Incoming) -> None:
        try:
            name = parse_topic(incoming.topic).command or ""
            command = decode(Command, incoming.payload, max_bytes=MAX_COMMAND_BYTES)
        except MessageError as error:
            # Without an envelope there is no request to answer by.
            self.refused += 1
            log.warning("command on %s dropped: %s", incoming.topic, error)
            return
        key = (name, command.request)
        task = self._answers.get(key)
        if task is None:
            task = asyncio.create_task(self._reply(name, command))
            self._answers[key] = task
            while len(self._answers) > MAX_REMEMBERED:
                self._answers.popitem(last=False)
        reply = await asyncio.shield(task)
        self._offer(
            Outgoing(
                _answer_topic(incoming) or reply_topic(self._arm, name),
                encode(reply, self._encoding),
                qos=1,
                correlation=incoming.correlation,
            )
        )

    async def _reply(self, name: str, command: Command) -> Reply:
        try:
            carry_out = self._carry_out.get(name)
            if carry_out is None:
                raise _not_available(name, sorted(self._carry_out))
            result = await carry_out(parse_args(name, command.args))
            return Reply(request=command.request, ok=True, result=dict(result))
        except MessageError as error:
            problem = CommandError(
                "command.bad_args", str(error), "correct the arguments and send again"
            )
        except CommandError as error:
            problem = error
        except Exception as error:
            log.exception("fault in command %s", name)
            problem = CommandError(
                "command.failed", repr(error), "report it with the daemon's log"
            )
        self.refused += 1
        log.warning("command %s refused: %s", name, problem)
        return Reply(
            request=command.request,
            ok=False,
            error=ReplyError(
                code=problem.code, text=str(problem)[:2000], remedy=problem.remedy
            ),
        )


def _answer_topic(incoming: Incoming) -> str | None:
    """The response topic, if one can publish to it."""
    topic = incoming.response_topic
    return None if topic is None or set(topic) & set("+#\0") else topic


def _not_available(name: str, available: list[str]) -> CommandError:
    what = "this version cannot do" if name in COMMANDS else "there is no command"
    return CommandError(
        "command.not_available",
        f"{what} {name!r}; it has: {', '.join(available)}",
        "use one of these commands",
    )
