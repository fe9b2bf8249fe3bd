"""What comes from an arm: decoded, and handed to those who wait for it."""

import logging
from collections.abc import Callable

from traverse.client.feeds import Feeds
from traverse.client.mqtt.connection import IncomingMessage
from traverse.client.mqtt.reconnection import Link
from traverse.client.points.index import PointIndex
from traverse.client.points.stream import PointStream
from traverse.client.requests import Requests
from traverse.protocol import topics
from traverse.protocol.encoding import decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import (
    Event,
    Health,
    Live,
    Point,
    Reply,
    Scan,
    Status,
)

log = logging.getLogger(__name__)

MAX_EVENTS = 1000
MAX_BLOCKS = 1000


class Inbox:
    """Sorts messages by their kind.

    Args:
        arm: its name.

    Attributes:
        topics: what is always asked for, with the quality of service. Answers come
            with 0: they must not wait behind points that are held back, and a command
            without an answer is sent again.
        undecodable: messages that could not be understood.
    """

    def __init__(self, arm: str) -> None:
        self.topics = {
            topics.status_topic(arm): 0,
            topics.health_topic(arm): 0,
            f"{topics.reply_topic(arm, 'any').removesuffix('any')}+": 0,
            topics.event_topic(arm): 1,
            topics.point_topic(arm): 1,
        }
        self.live_topic = (topics.live_topic(arm), 0)
        self.scan_topic = (topics.scan_topic(arm), 0)
        self.statuses = Feeds[Status](1, keep_newest=True)
        self.healths = Feeds[Health](1, keep_newest=True)
        self.events = Feeds[Event](MAX_EVENTS, keep_newest=True)
        self.lives = Feeds[Live](1, keep_newest=True)
        self.scans = Feeds[Scan](MAX_BLOCKS, keep_newest=False)
        self.by_id = PointIndex()
        self.undecodable = 0
        self._kinds: dict[str, Callable[[IncomingMessage], None]] = {
            "status": lambda m: self._take_status(decode(Status, m.payload)),
            "health": lambda m: self.healths.put(decode(Health, m.payload)),
            "event": self._take_event,
            "live": lambda m: self.lives.put(decode(Live, m.payload)),
            "scan": lambda m: self.scans.put(decode(Scan, m.payload)),
            "reply": lambda m: self._requests.take_reply(decode(Reply, m.payload)),
            "point": self._take_point,
        }

    def connect_consumers(
        self, link: Link, requests: Requests, stream: PointStream
    ) -> None:
        """Say who takes answers and points."""
        self._link = link
        self._requests = requests
        self._stream = stream

    def take(self, arrived: IncomingMessage) -> None:
        """A message has come."""
        kind = arrived.topic.split("/", 3)[2]
        try:
            self._kinds[kind](arrived)
        except MessageError as error:
            self.undecodable += 1
            log.warning("message on %s left out: %s", arrived.topic, error)
            if arrived.number:
                self._link.acknowledge(arrived.number)

    def close(self, error: BaseException | None = None) -> None:
        """Nothing more will come."""
        self._stream.close(error)
        for one in (self.statuses, self.healths, self.events, self.lives, self.scans):
            one.close(error)

    def _take_status(self, status: Status) -> None:
        self.statuses.put(status)
        if status.session is not None:
            self._stream.notice(status.session)
        self._requests.take_status(status)

    def _take_event(self, arrived: IncomingMessage) -> None:
        event = decode(Event, arrived.payload)
        self._link.acknowledge(arrived.number)
        self.events.put(event)

    def _take_point(self, arrived: IncomingMessage) -> None:
        point = decode(Point, arrived.payload)
        self.by_id.take(point)
        self._stream.take(point, arrived.number)
