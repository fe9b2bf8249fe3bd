"""Notice another publisher of this arm's status on the same broker.

Our retained status is published again where it was cleared, overwritten, or replaced by
the will of an earlier connection.

Two daemons of an arm share one client id, so that each connection ends the other. After
the broker has had our status, a status of another session is from another daemon. A
broker that has been restarted may once have an old one retained.
"""

from collections import deque
from collections.abc import Callable

from traverse.broker.pause import GrowingPause
from traverse.daemon.clock import HostClock
from traverse.daemon.monitoring.events import EventLog
from traverse.protocol.encoding import Encoding, decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import Status
from traverse.protocol.topics import status_topic

CODE = "broker.second_daemon"
UNREAD = "broker.status_unread"
OVERWRITTEN = "broker.status_overwritten"
RESTORE_S, LAST_RESTORE_S = 1.0, 60.0  # another program may do the same
UNREAD_NS = 10_000_000_000
MAX_SESSIONS = 1000
AWAY_S = 60.0
"""Time to stay away after giving way."""
OVER_NS = 150_000_000_000


class SecondDaemonWatch:
    """Compare every status of this arm with those that we have sent.

    Args:
        restore: publishes our status again.
    """

    def __init__(
        self,
        arm: str,
        encoding: Encoding,
        clock: HostClock,
        events: EventLog,
        restore: Callable[[], None] = lambda: None,
    ) -> None:
        self._arm = arm
        self._restore = restore
        self._sent_ns: deque[int] = deque(maxlen=MAX_SESSIONS)
        self._pause: GrowingPause | None = None  # while it is overwritten
        self._restored_ns = self._restore_again_ns = 0
        self._is_overwritten = False
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
        """The connection was made, with our status on its way, or was lost."""
        waits = is_connected and not self._has_read
        self._unread_since_ns = self._clock.monotonic_ns() if waits else None

    def sending(self, status: Status) -> Status:
        """Remember a status as ours; return it."""
        if status.session not in self._own:
            self._own.append(status.session)
        if status.online:
            self._sent_ns.append(status.time_ns)
        return status

    def receive(self, payload: bytes, *, retained: bool) -> None:
        """Process a status of this arm, perhaps our own."""
        self._unread_since_ns, self._has_read = None, True
        try:
            status = decode(Status, payload, self._encoding)
        except MessageError:  # empty: it was cleared
            self._is_overwritten |= not retained
            return
        if status.session in self._own:
            self._is_known = True
            # Else the will of an earlier connection of ours, or somebody's copy.
            is_ours = status.online and status.time_ns in self._sent_ns
            self._is_overwritten = not (retained or is_ours)
            return
        if not (status.online or retained):  # the will of an earlier daemon
            self._is_overwritten = True
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
        """Least time to stay away after the connection was lost [s].

        The daemon whose first session has the greater name gives way for a while.
        """
        gives_way = bool(self._other) and bool(self._own)
        return AWAY_S if gives_way and str(self._own[0]) > self._other else 0.0

    def poll(self) -> None:
        """Restore our status; report the other's end, and what is not received.

        The other has ended after some minutes without a status of it. That no status is
        received at all, not even our own, is reported once: many brokers accept a
        subscription and withhold what their access list does not allow.
        """
        now_ns, since_ns = self._clock.monotonic_ns(), self._unread_since_ns
        self._watch_status(now_ns)
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

    def _watch_status(self, now_ns: int) -> None:
        """Publish our status again where it was overwritten, more and more seldom."""
        topic = status_topic(self._arm)
        if self._is_overwritten and now_ns >= self._restore_again_ns:
            self._pause = self._pause or GrowingPause(RESTORE_S, LAST_RESTORE_S)
            self._restore_again_ns = now_ns + int(self._pause.after(None) * 1e9)
            self._restored_ns, self._is_overwritten = now_ns, False
            self._events.change(
                True,
                "warning",
                OVERWRITTEN,
                f"{topic} at the broker was not what this daemon had published; it is "
                "published again, each time later",
                remedy="allow the daemon's account alone to write there, in the "
                "broker's access list",
            )
            self._restore()
        elif self._pause is not None and now_ns - self._restored_ns > OVER_NS:
            self._pause = None
            text = f"{topic} has not been overwritten for some minutes"
            self._events.change(False, "warning", OVERWRITTEN, text)
