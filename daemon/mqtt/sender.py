"""One connection's messages on their way: written when offered, done when answered."""

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass

import aiomqtt

from traverse.daemon.mqtt.client import BrokerClient
from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage, OutgoingQueue

log = logging.getLogger("traverse.daemon.publisher")

ANSWER_S = 5.0
CHECK_S = 1.0
REFUSED_S = 5.0  # a refused point is tried again: the access list may be corrected


@dataclass(eq=False)
class PublishLoop:
    """Takes messages from the queue whenever the connection has room for them.

    A message is written in the call that offers it. Several may be on their way, so
    none waits for the answer to another.

    Args:
        properties: makes a message's packed properties, see `BrokerClient.send`.
        changed: called when points are refused (False, reason) and taken again (True).
        broker: how it is called, for people.
    """

    queue: OutgoingQueue
    _: KW_ONLY
    properties: Callable[[OutgoingMessage], bytes]
    changed: Callable[[bool, str], None]
    broker: str

    def __post_init__(self) -> None:
        self._client: BrokerClient | None = None
        self._in_flight: dict[int, tuple[str, OutgoingMessage, float]] = {}
        self._is_sending = False
        self._was_refused = False
        self._resumes_s = 0.0
        self._failed: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    async def run(self, client: BrokerClient) -> None:
        """Send until the connection fails; it calls `on_acknowledged` and `send`.

        Raises:
            aiomqtt.MqttError: it did, or the broker does not answer.
        """
        self._client, queue = client, self.queue
        try:
            with queue.notifying(self.send):
                while True:
                    self.send()
                    await asyncio.wait((self._failed,), timeout=CHECK_S)
                    if self._failed.done():
                        self._failed.result()
                    self._check_timeouts()
        finally:
            self._client = None
            self._in_flight.clear()
            queue.take_back()
            if not self._failed.cancel():
                self._failed.exception()  # it has been looked at

    def send(self) -> None:
        """Write as much as there is room for."""
        client = self._client
        if client is None or self._is_sending or self._failed.done() or self._resumes_s:
            return
        several = self.queue.n_waiting > 1
        self._is_sending = True
        try:
            with client.corked() if several else contextlib.nullcontext():
                while (
                    len(self._in_flight) < client.max_in_flight
                    and not client.is_congested
                    and (taken := self.queue.next()) is not None
                ):
                    self._send_one(client, *taken)
        except aiomqtt.MqttError as error:
            self._failed.set_exception(error)
        finally:
            self._is_sending = False

    def _send_one(
        self, client: BrokerClient, kind: str, message: OutgoingMessage
    ) -> None:
        try:
            number = client.send(message, self.properties(message))
        except ValueError as error:
            log.warning("%s: %s; dropped", message.topic, error)
            self.queue.drop(kind, message)
            return
        if message.qos:
            self._in_flight[number] = kind, message, time.monotonic()
        else:
            self.queue.done(kind, message)

    def on_acknowledged(self, number: int, refusal: str | None) -> None:
        """The broker has a message, or does not want it."""
        answered = self._in_flight.pop(number, None)
        if answered is None:
            return
        kind, message, _ = answered
        text = f"broker {self.broker} refuses {message.topic}: {refusal}"
        if refusal is None:
            self.queue.done(kind, message)
            if kind == "point" and self._was_refused:
                self._was_refused = False
                self.changed(True, f"broker {self.broker} takes points again")
        elif kind == "point":  # it is kept
            self._resumes_s = time.monotonic() + REFUSED_S
            if not self._was_refused:
                self._was_refused = True
                self.changed(False, text)
        elif message.refused is not None:
            log.warning("%s; tried again later", text)
            self.queue.defer(kind, message)
        else:
            log.warning("%s; dropped", text)
            self.queue.drop(kind, message)
        self.send()

    def _check_timeouts(self) -> None:
        """Notice silence, and the end of the wait after a refusal."""
        now_s = time.monotonic()
        if any(now_s - since_s > ANSWER_S for *_, since_s in self._in_flight.values()):
            raise aiomqtt.MqttError(f"no answer within {ANSWER_S:g} s")
        if self._resumes_s and now_s >= self._resumes_s:
            self._resumes_s = 0.0
            self._in_flight.clear()
            self.queue.take_back()
