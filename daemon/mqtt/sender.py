"""Messages on their way on one connection: written when offered, done when answered."""

import asyncio
import logging
import math
import time
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass

from traverse.broker.client import MqttClient
from traverse.broker.errors import MqttError
from traverse.broker.packets import Version, publish_packet
from traverse.broker.reasons import sentence
from traverse.daemon.mqtt.outgoing_queue import LIMITS, OutgoingMessage, OutgoingQueue
from traverse.daemon.mqtt.packet_limit import cut_to_fit
from traverse.daemon.mqtt.wording import WORDING

log = logging.getLogger("traverse.daemon.publisher")

ANSWER_S = 5.0
CHECK_S = 1.0
WRITE_BYTES = 65_536  # more is not collected before it is written
REFUSED_S = 5.0  # a refused point is tried again: the access list may be corrected
REPLY = "reply"  # its refusal says nothing of the broker: senders choose its topic
TOO_LONG = {
    "point": "points wait on the disk",
    "status": "nobody learns the state of the arm",
}
SHORTENED = "it is sent without its lists (probes, alarms, conditions)"


@dataclass(eq=False)
class PublishLoop:
    """Take messages from the queue whenever the connection has room for them.

    A message is written in the call that offers it. Several may be on their way, so
    none waits for the answer to another. What is sent at QoS 0 a broker refuses without
    a word; so the first message of each kind on a connection requests an answer, and
    after a refusal now and then another.

    Args:
        properties: makes a message's packed properties of MQTT 5.
        changed: called when messages of a kind are refused (False, reason), and when
            none are any more (True).
        limit_exceeded: see `BrokerConnection`.
        broker: name of the broker, for people.
    """

    queue: OutgoingQueue
    _: KW_ONLY
    properties: Callable[[OutgoingMessage], bytes]
    changed: Callable[[bool, str], None]
    limit_exceeded: Callable[[str, str], None]
    broker: str

    def __post_init__(self) -> None:
        self._client: MqttClient | None = None
        self._in_flight: dict[int, tuple[str, OutgoingMessage, float]] = {}
        self._is_sending = self._is_full = False
        self._refused: set[str] = set()
        self._request_from_s: dict[str, float] = {}  # by kind of QoS 0
        self._points_resume_s = 0.0
        self._failed: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    async def run(self, client: MqttClient) -> None:
        """Send until the connection fails; it calls `on_acknowledged` and `send`.

        Raises:
            MqttError: it failed, or the broker does not answer.
        """
        self._client, queue = client, self.queue
        self._request_from_s.clear()
        for kind in LIMITS:
            self.limit_exceeded(kind, "")
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
        client = self._client
        if client is None or self._is_sending or self._failed.done():
            return
        self._is_sending = True
        try:
            while (
                len(self._in_flight) < client.max_in_flight and not client.is_congested
            ):
                packets = self._next_packets(client)
                if not packets:
                    break
                client.write(b"".join(packets))
            self._is_full = len(self._in_flight) >= client.max_in_flight
        except MqttError as error:
            self._failed.set_exception(error)
        finally:
            self._is_sending = False

    def _next_packets(self, client: MqttClient) -> list[bytes]:
        """Packets of messages that may be sent now."""
        packets: list[bytes] = []
        n_bytes = 0
        while (
            len(self._in_flight) < client.max_in_flight
            and n_bytes < WRITE_BYTES
            and (
                next_message := self.queue.next(
                    "point" if self._points_resume_s else ""
                )
            )
        ):
            kind, message = next_message
            requests_answer = self._requests_answer(client, kind, message)
            number = client.next_number() if requests_answer else 0
            packet = self._packet(client, kind, message, number)
            if packet is None:
                continue
            packets.append(packet)
            n_bytes += len(packet)
            if number:
                self._in_flight[number] = kind, message, time.monotonic()
            else:
                self.queue.done(kind, message)
        return packets

    def _requests_answer(
        self, client: MqttClient, kind: str, message: OutgoingMessage
    ) -> bool:
        if message.qos:
            return True
        now_s = time.monotonic()
        begin_s = self._request_from_s.get(kind, 0.0)
        if client.version is not Version.V5 or now_s < begin_s:
            return False  # before MQTT 5 an answer is always yes
        self._request_from_s[kind] = now_s + REFUSED_S
        return True

    def _packet(
        self, client: MqttClient, kind: str, message: OutgoingMessage, number: int
    ) -> bytes | None:
        """Encode a message's packet; None if it cannot be sent as it is."""
        is_5 = client.version is Version.V5
        try:
            packet = publish_packet(
                message.topic,
                message.payload,
                qos=1 if number else 0,
                retain=message.retain,
                number=number,
                properties=self.properties(message) if is_5 else b"",
            )
        except ValueError as error:
            log.warning("%s: %s; dropped", message.topic, error)
            self.queue.drop(kind, message)
            return None
        limit_bytes = client.limits.maximum_packet_bytes
        if len(packet) <= limit_bytes:
            return packet
        overhead_bytes = len(packet) - len(message.payload)
        parts = cut_to_fit(kind, message, limit_bytes - overhead_bytes)
        outcome = TOO_LONG.get(kind, "it is left out")
        if parts:
            outcome = SHORTENED if kind == "status" else ""
            self.queue.replace(kind, message, parts)
        elif kind == "point":  # it is kept, and so are all after it
            self._points_resume_s = time.monotonic() + REFUSED_S
        else:
            self.queue.set_aside(kind, message)
        if outcome:
            self.limit_exceeded(
                kind,
                f"a message ({kind}) of {len(packet)} bytes is longer than the "
                f"{limit_bytes} that the broker takes; {outcome}",
            )
        return None

    def on_acknowledged(self, number: int, refusal: int | None) -> None:
        """Process an acknowledgement, or a refusal."""
        answered = self._in_flight.pop(number, None)
        if answered is None:
            return
        kind, message, _ = answered
        if refusal is None:
            self.queue.done(kind, message)
            if not message.qos:
                self._request_from_s[kind] = math.inf
            if kind in self._refused - {REPLY}:
                self._refused.remove(kind)
                if self._refused <= {REPLY}:
                    self.changed(True, f"broker {self.broker} takes all messages again")
        else:
            self._take_refusal(kind, message, sentence(refusal, WORDING))
        if self._is_full:
            self.send()

    def _take_refusal(self, kind: str, message: OutgoingMessage, why: str) -> None:
        if kind == "point":  # it is kept
            self._points_resume_s = time.monotonic() + REFUSED_S
        elif message.refused is not None:
            self.queue.defer(kind, message)
        else:
            self.queue.drop(kind, message)
        if kind not in self._refused:
            lasts_already = bool(self._refused - {REPLY})
            self._refused.add(kind)
            text = f"broker {self.broker} refuses {message.topic}: {why}"
            if kind == REPLY or lasts_already:
                log.warning("%s", text)
            else:
                self.changed(False, text)  # which logs it

    def _check_timeouts(self) -> None:
        """Notice silence, and the end of the wait after a refusal."""
        now_s = time.monotonic()
        if any(now_s - since_s > ANSWER_S for *_, since_s in self._in_flight.values()):
            raise MqttError(f"no answer within {ANSWER_S:g} s")
        if self._points_resume_s and now_s >= self._points_resume_s:
            self._points_resume_s = 0.0
            for number in [
                n for n, (kind, *_) in self._in_flight.items() if kind == "point"
            ]:
                del self._in_flight[number]
            self.queue.take_back(("point",))
