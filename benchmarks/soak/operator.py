"""`python -m benchmarks.soak.operator ARM BROKER RATE LOG`: commands points for ever.

Logs its requests and the replies: a point counts as acknowledged if the answer is ok.
"""

import asyncio
import contextlib
import json
from pathlib import Path
from typing import Any, TextIO

from benchmarks.tools.command_line import run_main
from traverse.broker.address import BrokerAddress
from traverse.client.errors import CommandRefused, NoAnswerError
from traverse.client.mqtt.connection import IncomingMessage, ReconnectingConnection
from traverse.client.requests import CommandClient
from traverse.protocol import topics
from traverse.protocol.encoding import decode
from traverse.protocol.messages import PointArgs, Reply, Status

ANSWER_S = 5.0
MOST_RUNNING = 8


class Operator:
    """Operator who commands points."""

    def __init__(self, arm: str, address: BrokerAddress, log: TextIO) -> None:
        self._log = log
        self._link = ReconnectingConnection(address)
        self._link.topics.update(
            {
                topics.status_topic(arm): 0,
                topics.reply_topic(arm, "point"): 0,
            }
        )
        self._requests = CommandClient(arm, self._link)
        self._running: set[asyncio.Task[None]] = set()

    async def work(self, rate_hz: float) -> None:
        """Request points at a rate, without regard to their fate."""
        connecting = asyncio.create_task(
            self._link.run(self._take, self._requests.link_changed)
        )
        try:
            while True:
                await asyncio.sleep(1.0 / rate_hz)
                if len(self._running) >= MOST_RUNNING:
                    continue
                task = asyncio.create_task(self._command_point())
                self._running.add(task)
                task.add_done_callback(self._running.discard)
        finally:
            connecting.cancel()

    async def _command_point(self) -> None:
        try:
            result = await self._requests.result(PointArgs(), ANSWER_S)
            self._write({"ok": True, **result})
        except CommandRefused as error:
            self._write({"ok": False, "code": error.code, "text": error.text})
        except NoAnswerError:
            self._write({"ok": False, "code": "none"})

    def _write(self, line: dict[str, Any]) -> None:
        self._log.write(json.dumps(line) + "\n")
        self._log.flush()

    def _take(self, arrived: IncomingMessage) -> None:
        if "/reply/" in arrived.topic:
            self._requests.take_reply(decode(Reply, arrived.payload))
        else:
            self._requests.take_status(decode(Status, arrived.payload))


async def main(arm: str, broker: str, rate_hz: float, path: Path) -> None:
    with path.open("a", encoding="utf-8") as log:
        await Operator(arm, BrokerAddress.parse(broker), log).work(rate_hz)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        run_main(main)
