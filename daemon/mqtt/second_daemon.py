"""Notice another daemon that reports as the same arm on the same broker.

Both connect with one client id, so that the broker ends the connection of each when the
other connects. A status of a session that is not ours tells who it was: once the broker
has had ours, every status of this arm is ours, unless somebody else publishes it. A
broker that has been restarted may once have an old one retained.
"""

from collections import deque

from traverse.daemon.clock import HostClock
from traverse.daemon.monitoring.events import EventLog
from traverse.protocol.encoding import Encoding, decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import Status
from traverse.protocol.topics import status_topic

CODE = "broker.second_daemon"
UNREAD = "broker.status_unread"
UNREAD_NS = 10_000_000_000
MAX_SESSIONS = 1000
AWAY_S = 60.0
"""How long the one of the two that gives way stays away."""
OVER_NS = 150_000_000_000


class SecondDaemonWatch:
    """Compares every status of this arm with our own sessions."""

    def __init__(
        self, arm: str, encoding: Encoding, clock: HostClock, events: EventLog
    ) -> None:
        self._arm = arm
        self._encoding = encoding
        self._clock = clock
        self._events = events
        self._own: deque[str | None] = deque(maxlen=MAX_SESSIONS)
        self._is_known = False
        self._retained = 0
        self._other = ""
        self._seen_ns = 0
        self._unread_since_ns: int | None = None
        self._has_read = False

    def connected(self, is_connected: bool) -> None:
        """The connection was made, and our status is on its way; or it was lost."""
        waits = is_connected and not self._has_read
        self._unread_since_ns = self._clock.monotonic_ns() if waits else None

    def sending(self, status: Status) -> Status:
        """Remember a status as ours; gives it back."""
        if status.session not in self._own:
            self._own.append(status.session)
        return status

    def receive(self, payload: bytes, *, retained: bool) -> None:
        """A status of this arm has arrived, perhaps our own."""
        self._unread_since_ns, self._has_read = None, True
        try:
            status = decode(Status, payload, self._encoding)
        except MessageError:
            return  # of another version, or of somebody who plays
        if status.session in self._own:
            self._is_known = True
            return
        if retained:
            self._retained += self._is_known
            if self._retained < 2:
                return
        self._other, self._seen_ns = status.session or "", self._clock.monotonic_ns()
        self._events.change(
            True,
            "error",
            CODE,
            f"another daemon reports as arm {self._arm} at this broker (session "
            f"{self._other}, version {status.version}); each throws the other out",
            remedy="end one of the two, or give its arm another name in the arm file",
        )

    @property
    def retry_s(self) -> float:
        """How long to stay away after the connection was lost, at least [s].

        The one whose first session has the greater name gives way, for a while.
        """
        gives_way = bool(self._other) and bool(self._own)
        return AWAY_S if gives_way and str(self._own[0]) > self._other else 0.0

    def poll(self) -> None:
        """Report its end after some minutes without a status of it.

        Also, once, that no status is received at all, not even our own: many brokers
        accept a subscription and withhold what their access list does not allow.
        """
        now_ns, since_ns = self._clock.monotonic_ns(), self._unread_since_ns
        if since_ns is not None and now_ns - since_ns > UNREAD_NS:
            self._unread_since_ns, self._has_read = None, True
            topic = status_topic(self._arm)
            self._events.report(
                "warning",
                UNREAD,
                f"the broker does not let this daemon read {topic}: a second daemon of "
                "this arm would not be noticed",
                remedy=f"allow the daemon's account to read and write {topic} in the "
                "broker's access list, as deploy/mosquitto/acl does",
            )
        if self._other and now_ns - self._seen_ns > OVER_NS:
            self._other, self._retained = "", 0
            text = f"no other daemon reports as arm {self._arm} any more"
            self._events.change(False, "error", CODE, text)
