"""All that the page knows of an arm, from its messages alone."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from traverse.arrays import Integers
from traverse.protocol.messages import Event, Health, Live, Point, Scan, Status

MAX_POINTS = 5000  # shown; all of them are in the arm's outbox
MAX_EVENTS = 200
STALE_S = 2.0
SECTORS = 36


@dataclass(frozen=True, slots=True)
class Change:
    """Something that every open page should show at once.

    Attributes:
        kind: "point", "retraction", "refused", "alarm", "cleared", "link", "status".
        text: for the user; empty where there is none.
        point: received.
    """

    kind: str
    text: str = ""
    point: Point | None = None


@dataclass(slots=True)
class ArmSight:
    """What is known of one arm.

    Args:
        now_s: a monotonic clock.

    Attributes:
        points: not retracted, by id, in the order of arrival.
        alarms: conditions that last, by code and source.
        events: the latest ones.
        coverage: samples seen in each of 36 sectors of a joint's reading,
            (n_joints, 36); None before the first pose.
        listeners: called with each change.
    """

    now_s: Callable[[], float]
    live: Live | None = None
    status: Status | None = None
    health: Health | None = None
    points: dict[str, Point] = field(default_factory=dict)
    alarms: dict[tuple[str, str], Event] = field(default_factory=dict)
    events: deque[Event] = field(default_factory=lambda: deque(maxlen=MAX_EVENTS))
    coverage: Integers | None = None
    scan: Scan | None = None
    is_linked: bool = False
    link_reason: str = "not connected yet"
    lost_points: int = 0
    listeners: list[Callable[[Change], None]] = field(default_factory=list)
    _live_s: float = -np.inf
    _health_s: float = -np.inf

    @property
    def age_s(self) -> float:
        """Time since the latest pose was received."""
        return self.now_s() - self._live_s

    @property
    def health_age_s(self) -> float:
        """Time since the latest figures were received."""
        return self.now_s() - self._health_s

    @property
    def is_stale(self) -> bool:
        """The shown values are out of date."""
        online = self.status is not None and self.status.online
        return not self.is_linked or not online or self.age_s > STALE_S

    @property
    def last_point(self) -> Point | None:
        """The last point that is not retracted."""
        return next(reversed(self.points.values()), None)

    def take_live(self, live: Live) -> None:
        """A pose was received."""
        self.live, self._live_s = live, self.now_s()
        angles_rad = np.array(live.angles_rad)
        if self.coverage is None or len(self.coverage) != len(angles_rad):
            self.coverage = np.zeros((len(angles_rad), SECTORS), dtype=np.int64)
        turns = np.mod(angles_rad / (2.0 * np.pi), 1.0)
        sectors = np.minimum((turns * SECTORS).astype(np.int64), SECTORS - 1)
        self.coverage[np.arange(len(sectors)), sectors] += 1

    def take_point(self, point: Point) -> None:
        """A point or a retraction was received."""
        if point.retracts is not None:
            self.points.pop(point.retracts, None)
            self._tell(Change("retraction", f"Point {point.seq} undoes one", point))
            return
        self.points[point.id] = point
        if len(self.points) > MAX_POINTS:
            self.points.pop(next(iter(self.points)))
        doubt = "" if point.quality.ok else ", in doubt: " + _words(point)
        self._tell(Change("point", f"Point {point.seq}{doubt}", point))

    def take_event(self, event: Event) -> None:
        """An event was received."""
        self.events.append(event)
        key = (event.code, event.source)
        if event.active is True:
            self.alarms[key] = event
            if event.severity != "info":
                self._tell(Change("alarm", event.text))
        elif event.active is False:
            if self.alarms.pop(key, None) is not None:
                self._tell(Change("cleared", event.text))
        elif event.code.endswith(".refused"):
            self._tell(Change("refused", event.text))

    def take_status(self, status: Status) -> None:
        """The arm's state was received."""
        was, self.status = self.status, status
        if was is None or was.session != status.session or not status.online:
            # Lasting conditions are published again by the new session.
            if was is not None and was.session != status.session:
                self.points.clear()
            if not status.online:
                self.alarms.clear()
        self._tell(Change("status"))

    def take_health(self, health: Health) -> None:
        """Figures were received."""
        self.health, self._health_s = health, self.now_s()

    def take_link(self, is_linked: bool, reason: str) -> None:
        """The connection to the broker was made or lost."""
        if (is_linked, reason) != (self.is_linked, self.link_reason):
            changed = is_linked != self.is_linked
            self.is_linked, self.link_reason = is_linked, reason
            if changed:
                self._tell(Change("link"))

    def _tell(self, change: Change) -> None:
        for listener in list(self.listeners):
            listener(change)


def _words(point: Point) -> str:
    return ", ".join(flag.replace("_", " ") for flag in point.quality.flags)
