"""Judge of the daemon's messages against the simulator's truth.

A number is a lie if it is unmarked and farther off, at the instant that it claims, than
four times its stated standard deviation plus `SLACK_MM`. A press at whose edge one
board latches all joints has to be there at the true instant of that press, and at the
instant that it claims, where its standard deviation holds besides how far the ball gets
in the stated bound of its time. The time of a press whose edge a board latches must not
be off by more than that bound plus `SLACK_S`; a bound that is not stated is 0. A number
is also a lie if it is unmarked and the computer's UTC is off by more than is stated: a
second if the kernel's clock is synchronised; else it may be from just before the latest
trusted time until 400 days after it. The stated standard deviation of a place is the
root of the trace of its covariance; without one, as of the first pose, that of the last
message.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.honesty.arm import ArmTruth
from benchmarks.honesty.hub import Hub
from traverse.arrays import Booleans, Floats, Integers
from traverse.protocol.messages import REMARKS, Live, Point, Scan
from traverse.protocol.messages.point import Covariance
from traverse.protocol.messages.quality import flag_names

SIGMAS, SLACK_MM = 4.0, 0.02
SLACK_S = 2e-5  # the same for an arm that moves at 1 m/s
SPEED_S = 1e-3  # before and after an instant, for its speed
FREEZE_SHOWN_S = 2.0  # in which each device has sent its counter
LEAST_UTC_S = 1.0  # that is shown as wrong
SETTLED_S = 5.0
LEAST_STD_MM = 0.01  # of the arms here, before any is stated
MOST_EXAMPLES = 20
OFFSETS_KEPT = 4
DIAGONAL = (0, 3, 5)  # of xx, xy, xz, yy, yz, zz


@dataclass(frozen=True, slots=True)
class Lie:
    """An unmarked number that is wrong."""

    kind: str
    at_s: float
    off_mm: float
    allowed_mm: float
    utc_off_s: float
    press_off_s: float = 0.0

    def __str__(self) -> str:
        text = (
            f"{self.kind} at {self.at_s:.3f} s: {self.off_mm:.3f} mm off, "
            f"{self.allowed_mm:.3f} allowed"
        )
        if abs(self.utc_off_s) > LEAST_UTC_S:
            text += f"; UTC {self.utc_off_s:.3g} s off"
        if self.press_off_s:
            text += f"; the press was {1e3 * self.press_off_s:.3f} ms beside"
        return text


@dataclass(frozen=True, slots=True, eq=False)
class Claims:
    """Claims of a message at n instants: times [UTC], places (n, 3), and doubt.

    Attributes:
        time_bound_s: How far the time may be off; 0 where nothing is stated.
    """

    kind: str
    times_ns: Integers
    xyz_mm: Floats
    ok: Booleans
    flags: list[str]
    time_bound_s: float = 0.0

    @classmethod
    def of(cls, kind: str, pose: Point | Live) -> "Claims":
        return cls(
            kind,
            np.array([pose.time_ns]),
            np.array([pose.xyz_mm]),
            np.array([pose.quality.ok]),
            [",".join(pose.quality.flags)],
            1e-9 * (getattr(pose, "time_bound_ns", None) or 0),
        )


@dataclass(eq=False)
class Tally:
    """Judged numbers, by kind of message.

    Attributes:
        doubts: marked numbers after `SETTLED_S`, by their flags.
        worst: of unmarked numbers, the largest share of the permitted error.
        unseen: numbers that a jump of a count made wrong that is too small to be seen,
            or a failed read before any that could be.
        press_off_s, press_share: of unmarked presses whose edge was latched, the
            largest error of the time, and the largest share of the permitted one.
        jump_rad: that jump, and the least one that can be seen.
    """

    ok: Counter[str] = field(default_factory=Counter)
    doubt: Counter[str] = field(default_factory=Counter)
    settled: Counter[str] = field(default_factory=Counter)
    lies: Counter[str] = field(default_factory=Counter)
    doubts: Counter[str] = field(default_factory=Counter)
    examples: list[Lie] = field(default_factory=list)
    worst: float = 0.0
    unseen: Counter[str] = field(default_factory=Counter)
    press_off_s: float = 0.0
    press_share: float = 0.0
    jump_rad: tuple[float, float] = 0.0, 0.0


class Judge:
    """Judges a world's messages as they come.

    Args:
        utc_s: True UTC at a true time.
        utc_tolerance_s: How far UTC may be back and ahead now.
        note: Called with each judged point, for people.
        presses_s: True times of presses, in order, if a board latches their edges;
            else none.
        latches_places: Whether it latches all joints with them.
        freezes_s: True times and lengths for which the computer's own clock stood
            still, (n, 2): no bound of another clock holds that until its next message.
    """

    def __init__(
        self,
        hub: Hub,
        truth: ArmTruth,
        utc_s: Callable[[float], float],
        utc_tolerance_s: Callable[[], tuple[float, float]],
        note: Callable[[str], object] = lambda text: None,
        *,
        presses_s: Sequence[float] = (),
        latches_places: bool = False,
        freezes_s: Sequence[tuple[float, float]] = (),
    ) -> None:
        self._hub, self._truth, self._utc_s, self._note = hub, truth, utc_s, note
        self.tally = Tally()
        self._presses_s = np.array(presses_s)
        self._latches_places = latches_places
        self._freezes_s = np.array(freezes_s).reshape(-1, 2)
        self._utc_tolerance_s = utc_tolerance_s
        self._last_std_mm = LEAST_STD_MM
        self._offsets_ns: list[int] = []
        self._pardoned_s = np.inf, np.inf
        self._is_named = True
        self._unseen_s = np.inf, np.inf
        self._unnamed: dict[str, Lie] = {}
        self._unnamed_samples: list[Lie] = []
        self._named_s: list[tuple[float, float]] = []

    def pardon(self, from_s: float, until_s: float, *, is_named: bool = True) -> None:
        """Judge no number of a time in which nothing can show yet that it is wrong.

        With ``is_named`` points and samples of that time have to be named by an event
        once it shows; else nobody measures then.
        """
        self._pardoned_s, self._is_named = (from_s, until_s), is_named

    def note_unseen(self, from_s: float, until_s: float = np.inf) -> None:
        """Count by themselves what is made wrong by what nothing can show."""
        self._unseen_s = from_s, until_s

    def take_doubt(self, data: Mapping[str, Any]) -> None:
        """Note what an event puts in doubt that was published before it."""
        for point_id in str(data.get("points", "")).split():
            self._unnamed.pop(point_id, None)
        if "from_ns" in data:
            from_s, until_s = (
                self._hub.true_s(int(data[name]) - self._offsets_ns[0])
                for name in ("from_ns", "until_ns")
            )
            self._named_s.append((from_s, until_s))

    def finish(self) -> None:
        """Count wrong points and samples that no event has named until the end.

        A block of samples may be published after the event that names its time.
        """
        unnamed_samples = (
            lie
            for lie in self._unnamed_samples
            if not any(begin <= lie.at_s <= end for begin, end in self._named_s)
        )
        for lie in (*self._unnamed.values(), *unnamed_samples):
            self._add_lie(lie)

    def point(self, point: Point, utc_offset_ns: int) -> None:
        if point.retracts is not None:
            return
        std_mm = self._std_mm(point.covariance_mm2)
        kind = "mean" if point.samples > 1 else point.trigger
        for lie in self._judge(Claims.of(kind, point), std_mm, utc_offset_ns):
            if self._is_named:
                self._unnamed[point.id] = lie

    def live(self, live: Live, utc_offset_ns: int) -> None:
        std_mm = self._std_mm(live.covariance_mm2)
        self._judge(Claims.of("live", live), std_mm, utc_offset_ns)

    def scan(self, scan: Scan, utc_offset_ns: int) -> None:
        if not len(scan.dtime_ns):
            return
        bits = scan.quality.astype(np.int64)
        claims = Claims(
            "scan",
            scan.time_ns + scan.dtime_ns,
            scan.xyz_mm,
            (bits & ~REMARKS.value) == 0,
            [",".join(flag_names(word)) for word in bits.tolist()],
        )
        variances_mm2 = scan.covariance_mm2
        std_mm = (
            np.full(len(claims.ok), self._last_std_mm)
            if variances_mm2 is None
            else np.sqrt(variances_mm2[:, DIAGONAL].sum(axis=1))
        )
        lies = self._judge(claims, std_mm, utc_offset_ns)
        if self._is_named:
            self._unnamed_samples += lies

    def _judge(self, claims: Claims, std_mm: Floats, utc_offset_ns: int) -> list[Lie]:
        """Count numbers and lies; return the lies that are pardoned."""
        kind, times_ns, xyz_mm = claims.kind, claims.times_ns, claims.xyz_mm
        ok, flags = claims.ok, claims.flags
        offsets = self._offsets_ns
        if utc_offset_ns not in offsets:
            offsets.insert(0, utc_offset_ns)
            del offsets[OFFSETS_KEPT:]
        off_mm, at_s, utc_off_s = self._errors(times_ns, xyz_mm)
        for other_ns in offsets[1:]:  # a block may have begun before UTC was set
            if (np.abs(utc_off_s) > 60.0).any() or len(times_ns) > 1:
                otherwise = self._errors(times_ns, xyz_mm, other_ns)
                better = otherwise[0] < off_mm
                off_mm = np.where(better, otherwise[0], off_mm)
                at_s = np.where(better, otherwise[1], at_s)
        tally = self.tally
        allowed_mm = SLACK_MM + SIGMAS * std_mm
        back_s, ahead_s = self._utc_tolerance_s()
        wrong = (utc_off_s < -back_s) | (utc_off_s > ahead_s)
        press_off_s = 0.0
        if kind == "button" and len(self._presses_s):
            is_lie, press_off_s = self._judge_press(claims, at_s, off_mm, std_mm)
            wrong |= is_lie
            if self._latches_places:
                off_mm = self._off_mm(self._nearest_presses_s(at_s), xyz_mm)
        wrong |= off_mm > allowed_mm
        from_s, until_s = self._pardoned_s
        pardoned = wrong & (at_s >= from_s) & (at_s <= until_s)
        wrong &= ~pardoned
        tally.ok[kind] += int(ok.sum())
        tally.doubt[kind] += int((~ok).sum())
        if ok.any():
            tally.worst = max(tally.worst, float((off_mm / allowed_mm)[ok].max()))
        for row in np.flatnonzero(~ok).tolist():
            if at_s[row] > SETTLED_S:
                tally.settled[kind] += 1
                tally.doubts[flags[row]] += 1
        columns = np.column_stack([at_s, off_mm, allowed_mm, utc_off_s])

        def lie_of(row: int) -> Lie:
            at, off, allowed, utc_off = columns[row].tolist()
            return Lie(kind, at, off, allowed, utc_off, press_off_s)

        for row in np.flatnonzero(ok & wrong).tolist():
            self._add_lie(lie_of(row))
        if kind not in ("live", "scan") or (ok & wrong).any() or (~ok).any():
            worst = int(np.argmax(off_mm * (1 + ok)))
            state = "LIE" if (ok & wrong).any() else "ok" if ok.all() else "doubt"
            self._note(
                f"{self._hub.now_s:9.4f} {state:5} {kind} of {at_s[worst]:.4f}: "
                f"{off_mm[worst]:.4f} mm off, {allowed_mm[worst]:.4f} allowed, "
                f"UTC {utc_off_s[worst]:.3g} s, {flags[worst] or 'no flags'}"
            )
        return [lie_of(row) for row in np.flatnonzero(ok & pardoned).tolist()]

    def _judge_press(
        self, claims: Claims, at_s: Floats, off_mm: Floats, std_mm: Floats
    ) -> tuple[bool, float]:
        """Judge a press whose edge was latched by the bound of its time.

        Args:
            claims: Of one point.
            at_s: (1,) true time that it claims.
            off_mm: (1,) how far its place is off at that time.
            std_mm: (1,) as it states.

        Returns:
            whether it is wrong, and the error of its time.
        """
        presses_s, bound_s = self._nearest_presses_s(at_s), claims.time_bound_s
        press_off_s = float(np.abs(at_s - presses_s)[0])
        since_s = presses_s - self._freezes_s[:, 0]
        is_unshown = (since_s >= 0.0) & (since_s < FREEZE_SHOWN_S)
        lost_s = float(self._freezes_s[is_unshown, 1].sum())
        share = press_off_s / (SLACK_S + bound_s + lost_s)
        if claims.ok.all():
            self.tally.press_off_s = max(self.tally.press_off_s, press_off_s)
            self.tally.press_share = max(self.tally.press_share, share)
        if share > 1.0 or not self._latches_places:
            return share > 1.0, press_off_s
        speeds_mm_s = self._speeds_mm_s(np.concatenate([presses_s, at_s]))
        way_mm = float(speeds_mm_s.max()) * bound_s
        allowed_mm = SLACK_MM + SIGMAS * np.hypot(std_mm, way_mm / np.sqrt(3.0))
        return bool((off_mm > allowed_mm).any()), press_off_s

    def _add_lie(self, lie: Lie) -> None:
        from_s, until_s = self._unseen_s
        if from_s <= lie.at_s <= until_s:
            self.tally.unseen[lie.kind] += 1
            return
        self.tally.lies[lie.kind] += 1
        if len(self.tally.examples) < MOST_EXAMPLES:
            self.tally.examples.append(lie)

    def _errors(
        self,
        times_ns: Integers,
        xyz_mm: Floats,
        offset_ns: int | None = None,
    ) -> tuple[Floats, Floats, Floats]:
        """Return errors of places (n, 3), their true times, and the error of UTC."""
        hub = self._hub
        offset_ns = self._offsets_ns[0] if offset_ns is None else offset_ns
        at_s = np.array([hub.true_s(int(t) - offset_ns) for t in times_ns.tolist()])
        off_mm = self._off_mm(at_s, xyz_mm)
        utc_off_s = np.array(
            [
                (int(t) - round(1e9 * self._utc_s(float(instant_s)))) * 1e-9
                for t, instant_s in zip(times_ns.tolist(), at_s, strict=True)
            ]
        )
        return off_mm, at_s, utc_off_s

    def _off_mm(self, at_s: Floats, xyz_mm: Floats) -> Floats:
        """Return how far places (n, 3) are off at true times (n,)."""
        off_mm: Floats = np.linalg.norm(xyz_mm - self._truth.centres_mm(at_s), axis=1)
        return off_mm

    def _speeds_mm_s(self, at_s: Floats) -> Floats:
        """Return how fast the ball is at true times (n,)."""
        before_mm, after_mm = (
            self._truth.centres_mm(at_s + half_s) for half_s in (-SPEED_S, SPEED_S)
        )
        way_mm: Floats = np.linalg.norm(after_mm - before_mm, axis=1)
        return way_mm / (2.0 * SPEED_S)

    def _nearest_presses_s(self, at_s: Floats) -> Floats:
        away_s = np.abs(self._presses_s - at_s[:, np.newaxis])
        nearest: Floats = self._presses_s[away_s.argmin(axis=1)]
        return nearest

    def _std_mm(self, covariance_mm2: Covariance | None) -> Floats:
        if covariance_mm2 is not None:
            xx, _, _, yy, _, zz = covariance_mm2
            self._last_std_mm = float(np.sqrt(xx + yy + zz))
        return np.array([self._last_std_mm])
