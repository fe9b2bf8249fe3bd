"""From values to messages on their way: topic, quality of service, encoding."""

from dataclasses import dataclass, field

from traverse.daemon.clock import HostClock
from traverse.daemon.monitoring.events import Occurrence
from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage, OutgoingQueue
from traverse.daemon.step_listener import StepListener
from traverse.protocol import topics
from traverse.protocol.encoding import Encoding, encode
from traverse.protocol.messages import Event, Message


@dataclass(eq=False)
class MessagePublisher:
    """Encode the arm's messages and put them into the outgoing queue."""

    arm: str
    encoding: Encoding
    queue: OutgoingQueue
    clock: HostClock
    listener: StepListener = field(default_factory=StepListener)

    def outgoing(self, kind: str, message: Message) -> OutgoingMessage:
        channel = topics.CHANNELS[kind]
        return OutgoingMessage(
            f"{topics.ROOT}/{self.arm}/{kind}",
            encode(message, self.encoding),
            qos=channel.qos,
            retain=channel.retained,
        )

    def publish(self, kind: str, message: Message, *, at_once: bool = True) -> bool:
        """Queue a message; return False if there was no room for it."""
        outgoing = self.outgoing(kind, message)
        is_queued = self.queue.offer(kind, outgoing, at_once=at_once)
        if is_queued:
            self.listener.published(self.clock.monotonic_ns(), message)
        return is_queued

    def publish_event(self, occurrence: Occurrence, session: str) -> None:
        """Queue an event; its times become UTC.

        What informs only, such as of each press, waits for another message.
        """
        offset_ns = self.clock.utc_offset_ns()
        event = Event(
            arm=self.arm,
            session=session,
            severity=occurrence.severity,
            code=occurrence.code,
            text=occurrence.text[:2000],
            remedy=occurrence.remedy[:2000],
            source=occurrence.source[:64],
            active=occurrence.active,
            first_ns=occurrence.first_ns + offset_ns,
            last_ns=occurrence.last_ns + offset_ns,
            count=occurrence.count,
            data=dict(occurrence.data),
        )
        is_urgent = occurrence.severity != "info" or occurrence.active is not None
        self.publish("event", event, at_once=is_urgent)
