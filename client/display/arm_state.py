"""Knowledge of an arm for displays, from its messages alone."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from traverse.arrays import Integers
from traverse.client.display.figures import flag_words
from traverse.plurals import counted
from traverse.protocol.messages import (
    Alarm,
    Clock,
    Event,
    Health,
    Label,
    Live,
    Point,
    Scan,
    Status,
)
from traverse.protocol.messages.later_doubt import LaterDoubt

MAX_POINTS = 5000  # of a session that are shown; all of them are in the arm's outbox
MAX_SESSIONS = 8
MAX_EVENTS = 200
MAX_DOUBTS = 16
STALE_S = 1.0
SILENT_S = 1.5  # the clock of the arm comes twice a second
HEALTH_STALE_S = 10.0
STORED_NS = 3_000_000_000  # a mean of many samples is of the middle of its time
SAME_REFUSAL_S = 3.0
SECTORS = 36


@dataclass(frozen=True, slots=True)
class Change:
    """A change that every open page should show at once.

    Attributes:
        kind: "point", "retraction", "stored" (either of them, older, received late),
            "doubt" (a point that is in doubt since it was taken),
            "scan" (ended), "refused", "alarm", "cleared", "link", "status",
            "absent" (no message of this arm was received).
        text: for the user; may be empty.
    """

    kind: str
    text: str = ""
    point: Point | None = None


@dataclass(frozen=True, slots=True)
class ScanProgress:
    """Progress of a scan.

    Attributes:
        lost: dropped by the daemon, or lost between device and daemon.
        in_doubt: points with a flag that is no remark.
    """

    scan: str
    runs: bool
    points: int = 0
    lost: int = 0
    in_doubt: int = 0

    @property
    def text(self) -> str:
        noun = counted(self.points, "point").split()[-1]
        words = f"{self.points:,} {noun}, {self.lost or 'none'} lost"
        doubt = f", {self.in_doubt:,} in doubt" if self.in_doubt else ""
        return f"{'Scanning' if self.runs else 'Scan ended'}: {words}{doubt}"


@dataclass(slots=True)
class ArmSight:
    """Last known state of one arm.

    Attributes:
        sessions: points not retracted, by session and id, in the order of arrival.
        shown_session: an earlier session to be shown; None: the arm's.
        alarms: lasting conditions, by code and source.
        coverage: samples received in each of 36 sectors of a joint's reading,
            (n_joints, 36); None before the first pose.
        scan: the latest; None if unknown.
        label: of the next points; None while unknown.
        probe: name of the probe; empty while unknown.
        aligned_ns: last change of the alignment, as far as known.
        absence: message that the broker has no arm of this name; else empty.
        listeners: called with each change.
        scan_listeners: called with each block of a scan.
        doubts: the latest of numbers that are here, or in a feature.
        doubt_listeners: called with each of them.
    """

    now_s: Callable[[], float]
    live: Live | None = None
    status: Status | None = None
    health: Health | None = None
    sessions: dict[str, dict[str, Point]] = field(default_factory=dict)
    shown_session: str | None = None
    alarms: dict[tuple[str, str], Event | Alarm] = field(default_factory=dict)
    events: deque[Event] = field(default_factory=lambda: deque(maxlen=MAX_EVENTS))
    coverage: Integers | None = None
    scan: ScanProgress | None = None
    label: Label | None = None
    probe: str = ""
    aligned_ns: int = 0
    is_linked: bool = False
    link_reason: str = "not connected yet"
    lost_points: int = 0
    absence: str = ""
    listeners: list[Callable[[Change], None]] = field(default_factory=list)
    scan_listeners: list[Callable[[Scan], None]] = field(default_factory=list)
    doubts: deque[LaterDoubt] = field(default_factory=lambda: deque(maxlen=MAX_DOUBTS))
    doubt_listeners: list[Callable[[LaterDoubt], None]] = field(default_factory=list)
    _live_s: float = -np.inf
    _live_intervals_s: deque[float] = field(default_factory=lambda: deque(maxlen=5))
    _clock_s: float | None = None
    _health_s: float = -np.inf
    _online_s: float = -np.inf
    _health_period_s: float = 0.0
    _refusal: tuple[str, bool, float] = ("", False, -np.inf)

    @property
    def age_s(self) -> float:
        return self.now_s() - self._live_s

    @property
    def health_age_s(self) -> float:
        return self.now_s() - self._health_s

    @property
    def is_online(self) -> bool:
        return self.is_linked and self.status is not None and self.status.online

    @property
    def is_stale(self) -> bool:
        longest_s = max(STALE_S, 3.0 * min(self._live_intervals_s, default=0.0))
        return not self.is_online or self.is_silent or self.age_s > longest_s

    @property
    def silence_s(self) -> float:
        """Age of the daemon's last clock message; 0 before the first."""
        return 0.0 if self._clock_s is None else self.now_s() - self._clock_s

    @property
    def is_silent(self) -> bool:
        """Whether broker and arm seem to be there, but nothing arrives."""
        return self.is_online and self.silence_s > SILENT_S

    @property
    def is_health_stale(self) -> bool:
        longest_s = max(HEALTH_STALE_S, 3.0 * self._health_period_s)
        is_heard = self.is_online and not self.is_silent
        return not is_heard or self.health_age_s > longest_s

    @property
    def is_health_missing(self) -> bool:
        """Whether no figures have come for long, or since the arm is there."""
        online_s = self.now_s() - self._online_s
        return self.is_online and self.is_health_stale and online_s > HEALTH_STALE_S

    @property
    def session(self) -> str:
        """The arm's session; empty before the first."""
        return (self.status and self.status.session) or ""

    @property
    def points(self) -> dict[str, Point]:
        """Points to be shown, by id: of the arm's session, or of an earlier one."""
        return self.sessions.get(self.shown_session or self.session, {})

    @property
    def earlier_session(self) -> str | None:
        shown = self.shown_session or self.session
        before = []
        for session, points in self.sessions.items():
            if session == shown:
                break
            if points:
                before.append(session)
        return before[-1] if before else None

    @property
    def last_point(self) -> Point | None:
        held = self.sessions.get(self.session, {})
        return next(reversed(held.values()), None)

    @property
    def is_aligned(self) -> bool:
        known = self.live or self.last_point
        return known is not None and known.part_xyz_mm is not None

    @property
    def known_label(self) -> Label | None:
        if self.label is None and self.last_point is not None:
            return self.last_point.label
        return self.label

    def take_live(self, live: Live) -> None:
        if self.live is not None:
            self._live_intervals_s.append(self.age_s)
        self.live, self._live_s = live, self.now_s()
        angles_rad = np.array(live.angles_rad)
        if self.coverage is None or len(self.coverage) != len(angles_rad):
            self.coverage = np.zeros((len(angles_rad), SECTORS), dtype=np.int64)
        turns = np.mod(angles_rad / (2.0 * np.pi), 1.0)
        sectors = np.minimum((turns * SECTORS).astype(np.int64), SECTORS - 1)
        self.coverage[np.arange(len(sectors)), sectors] += 1

    def take_clock(self, clock: Clock) -> None:
        self._clock_s = self.now_s()

    def take_point(self, point: Point) -> None:
        held = self._points_of(point.session)
        is_new = self._is_new(point)
        if point.retracts is not None:
            undone = held.pop(point.retracts, None)
            undone_seq = "one" if undone is None else str(undone.seq)
            change = Change(
                "retraction", f"Point {point.seq} undoes {undone_seq}", point
            )
        else:
            held[point.id] = point
            if len(held) > MAX_POINTS:
                held.pop(next(iter(held)))
            doubt = "" if point.quality.ok else f", in doubt: {flag_words(point)}"
            change = Change("point", f"Point {point.seq}{doubt}", point)
        self._notify(change if is_new else Change("stored", point=point))

    def take_event(self, event: Event) -> None:
        self.events.append(event)
        key = (event.code, event.source)
        if event.active is True:
            self.alarms[key] = event
            if event.severity != "info":
                self._notify(Change("alarm", event.text))
        elif event.active is False:
            if self.alarms.pop(key, None) is not None:
                ended = "" if "ended" in event.text.lower() else "Ended: "
                self._notify(Change("cleared", f"{ended}{event.text}"))
        elif event.code.endswith(".refused"):
            self.refuse(event.text, event.remedy, by_event=True)
        elif event.code == "capture.label":
            self.label = Label(
                artefact=event.data.get("artefact") or None,
                feature=event.data.get("feature") or None,
            )
        elif event.code == "capture.probe":
            self.probe = str(event.data.get("probe", ""))
        elif event.code == "capture.alignment":
            self.aligned_ns = event.last_ns

    def take_doubt(self, doubt: LaterDoubt) -> None:
        """Flag what is in doubt since it was taken."""
        self.doubts.append(doubt)
        for held in self.sessions.values():
            for point in [*held.values()]:
                if (flagged := doubt.flagged(point)) is not point:
                    held[point.id] = flagged
                    text = f"Point {point.seq}, in doubt: {flag_words(flagged)}"
                    self._notify(Change("doubt", text, flagged))
        for listener in self.doubt_listeners:
            listener(doubt)

    def refuse(self, text: str, remedy: str = "", *, by_event: bool = False) -> None:
        """Report a refusal once, although answer and event both contain it."""
        before, was_event, at_s = self._refusal
        now_s = self.now_s()
        if (before, was_event) == (
            text,
            not by_event,
        ) and now_s - at_s < SAME_REFUSAL_S:
            self._refusal = ("", False, -np.inf)
            return
        self._refusal = (text, by_event, now_s)
        words = [part.strip().rstrip(".") for part in (text, remedy) if part]
        self._notify(Change("refused", ". ".join(w[:1].upper() + w[1:] for w in words)))

    def take_status(self, status: Status) -> None:
        was, self.status = self.status, status
        if was is not None and was.session != status.session:
            self.shown_session, self.scan = None, None
        if was is None or not was.online:
            self._online_s = self.now_s()
        if status.session is not None:
            self._points_of(status.session)
        if not status.online:
            # The next daemon reports its own lasting conditions.
            self.alarms.clear()
            self.scan, self.label, self.probe = None, None, ""
            self._clock_s = None
        else:
            # Includes those that began or ended while disconnected.
            self.alarms = {(a.code, a.source): a for a in status.alarms}
        self.label = status.label or self.label
        self.probe = status.probe or self.probe
        self._notify(Change("status"))

    def take_health(self, health: Health) -> None:
        if self.health is not None and not self.is_health_stale:
            self._health_period_s = self.health_age_s
        self.health, self._health_s = health, self.now_s()

    def take_scan(self, block: Scan) -> None:
        self.scan = ScanProgress(
            block.scan,
            not block.last,
            block.seq + len(block.dtime_ns) - block.dropped,
            block.dropped + block.lost,
            block.in_doubt,
        )
        for listener in self.scan_listeners:
            listener(block)
        if block.last:
            self._notify(Change("scan", f"{self.scan.text}."))

    def scan_started(self, scan: str) -> None:
        """Take a scan that has begun and may have no points yet."""
        if self.scan is None or self.scan.scan != scan:
            self.scan = ScanProgress(scan, runs=True)

    def take_link(self, is_linked: bool, reason: str) -> None:
        if (is_linked, reason) != (self.is_linked, self.link_reason):
            changed = is_linked != self.is_linked
            self.is_linked, self.link_reason = is_linked, reason
            if changed:
                self._clock_s = None
                if not is_linked:  # what ends or begins meanwhile is not received
                    self.scan = None
                    self.label = None if self.status is None else self.status.label
                self._notify(Change("link"))

    def take_absence(self, text: str) -> None:
        if text and self.status is None and text != self.absence:
            self.absence = text
            self._notify(Change("absent", text))

    def _points_of(self, session: str) -> dict[str, Point]:
        held = self.sessions.setdefault(session, {})
        if len(self.sessions) > MAX_SESSIONS:
            del self.sessions[next(iter(self.sessions))]
        return held

    def _is_new(self, point: Point) -> bool:
        if self.live is None or self.is_stale:
            return False
        return self.live.time_ns - point.time_ns < STORED_NS

    def _notify(self, change: Change) -> None:
        for listener in list(self.listeners):
            listener(change)
