"""Scans: points selected from the stream, in blocks."""

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from traverse.arrays import Bits, Floats, Integers
from traverse.daemon.clock import STEP_NS, HostClock
from traverse.daemon.config.filters import filter_chain
from traverse.daemon.config.schema import ScanSection
from traverse.daemon.pose.alignment import ActiveAlignment, Alignment
from traverse.daemon.pose.arm_model import ArmModel
from traverse.daemon.pose.poses import PoseBlock
from traverse.daemon.scans.between import ScanInstants
from traverse.daemon.scans.plan import ScanPlan
from traverse.daemon.scans.selection import ButtonGate, ButtonKey, ScanSelection
from traverse.kinematics.filters import PointBlock
from traverse.protocol.messages import REMARKS, QualityFlag, Scan

MAX_POINTS = 1000  # of a message: half a megabyte with 32 joints
ScanSink = Callable[[Scan, Callable[[], object]], bool]
"""Takes a block; False if it is dropped. Calls the callback if it is dropped later."""


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """Instants of a scan, and the arm that they were measured with."""

    model: ArmModel
    alignment: Alignment | None
    instants: PointBlock


class Scanner:
    """Collects the points of a scan and passes them on in blocks.

    Args:
        block_s: duration of a block.
        settings: filters, and the largest delay of a button's edge.

    Attributes:
        chain: the filters, with their counts of removed points.
        stream_started: set when the scan's stream has begun.
        instants: of its samples; None: they are those of its stream.
    """

    def __init__(
        self,
        clock: HostClock,
        offer: ScanSink,
        block_s: float,
        settings: ScanSection | None = None,
        part: ActiveAlignment | None = None,
    ) -> None:
        self._clock = clock
        self._part = part or ActiveAlignment()
        self._offer = offer
        self._gate = ButtonGate()
        self.plan: ScanPlan | None = None
        self.instants: ScanInstants | None = None
        self.session = ""
        self.dropped_points = 0
        self.published_points = 0
        self.stream_started = asyncio.Event()
        self.use_settings(block_s, settings or ScanSection())

    @property
    def is_running(self) -> bool:
        return self.plan is not None

    def use_settings(self, block_s: float, settings: ScanSection) -> None:
        """Change the settings; a running scan keeps its filters."""
        self._block_ns = int(block_s * 1e9)
        self._held_wait_ns = int(settings.held_wait_s * 1e9)
        self.chain = filter_chain(settings.filters)

    def start(self, plan: ScanPlan, model: ArmModel, session: str) -> None:
        """Begin; points start when the device streams at the plan's rate."""
        self.stream_started.clear()
        self.plan = self._plan = plan
        self._requested_hz = plan.device_rate_hz
        self.session = session
        self._model = model
        self._alignment = self._part.alignment
        self._selection = ScanSelection(
            plan, self.chain, self._gate if plan.held else None
        )
        self._next = self._lost = self._dropped = self._in_doubt = 0
        self._stream: int | None = None
        self.instants = ScanInstants(plan.rate_hz) if plan.read_hz else None
        self._utc_offset_ns, self._stepped_ns = self._clock.utc_offset_ns(), 0
        self._offset = 0
        self._last: tuple[int, int] | None = None
        self._decided_ns = 0  # until here it is settled what was held
        self._undecided: deque[_Piece] = deque()
        self._waiting: list[PointBlock] = []
        self._period_ns = int(np.ceil(1e9 / plan.rate_hz))

    def follow(self, stream: int, rate_hz: float, requested_hz: float = 0.0) -> bool:
        """Take the start of a stream; True if it is the scan's.

        The scan then has the rate that the device states.
        """
        plan, requested_hz = self.plan, requested_hz or rate_hz
        off_hz = abs(requested_hz - self._requested_hz) if plan else 0.0
        if plan is None or off_hz > 0.001 * requested_hz + 0.001:
            return False
        if rate_hz != requested_hz:
            self.plan = self._plan = plan.on_stream(rate_hz)
            self._period_ns = int(np.ceil(1e9 / self._plan.rate_hz))
        self._stream = stream
        self._resuming = self._last is not None
        self.stream_started.set()
        return True

    def edge(self, button: ButtonKey, time_ns: int, held: bool) -> float:
        """Take a button's edge at a host monotonic time.

        Returns how much too late it was for the running scan [s]; 0 if in time.
        """
        self._gate.edge(button, time_ns, held)
        if self.plan is None or not self.plan.held:
            return 0.0
        return max(0.0, (self._decided_ns - time_ns) * 1e-9)

    def needs(self, poses: PoseBlock) -> bool:
        """Return whether a running scan is made of a block's stream."""
        return self.plan is not None and poses.stream == self._stream

    def take(
        self, model: ArmModel, poses: PoseBlock, covariances_mm2: Floats | None = None
    ) -> None:
        """Take poses, with their covariances (n, 6), NaN or None where unknown."""
        plan = self.plan
        if plan is None or not self.needs(poses):
            return
        rows = poses.seq % plan.every == 0
        if not rows.any():
            return
        if covariances_mm2 is None:
            covariances_mm2 = np.full((len(rows), 6), np.nan)
        if not rows.all():
            poses, covariances_mm2 = poses.rows(rows), covariances_mm2[rows]
        instants = self._instants(plan, poses, covariances_mm2)
        last_ns = int(instants.time_ns[-1])
        piece = _Piece(model, self._part.alignment, instants)
        if plan.held:
            self._undecided.append(piece)
            self._decide(last_ns - self._held_wait_ns)
        else:
            self._select(piece)
        if self._waiting:
            n_waiting = sum(len(points) for points in self._waiting)
            waited_ns = last_ns - int(self._waiting[0].time_ns[0])
            if (
                n_waiting * self._period_ns >= self._block_ns
                or waited_ns >= self._block_ns
            ):
                self._flush()

    def stop(self) -> int:
        """End the scan; return its number of points, lost and dropped ones included."""
        if self.plan is None:
            return 0
        self._decide(None)
        self._flush(last=True)
        self.plan = None
        return self._next

    def _drop_published(self, scan: str, n: int) -> None:
        """Count points of a scan that were dropped after they had been passed on."""
        self.published_points -= n
        self.dropped_points += n
        if self.plan is not None and self.plan.id == scan:
            self._dropped += n

    def _instants(
        self, plan: ScanPlan, poses: PoseBlock, covariances_mm2: Floats
    ) -> PointBlock:
        """Return the candidate samples, numbered from the scan's start."""
        numbers = poses.seq // plan.every
        times_ns = poses.sample_time_ns
        before_ns = int(times_ns[0])
        if self._last is not None:
            last, last_ns = self._last
            if self._resuming:  # the number there counts through the outage
                missed = (int(times_ns[0]) - last_ns) * 1e-9 * plan.rate_hz
                self._offset = last + max(1, round(missed)) - int(numbers[0])
            before_ns = max(before_ns, last_ns)
        self._resuming = False
        numbers = numbers + self._offset
        # A clock that is set right a little must not turn back the order of points.
        times_ns = np.maximum.accumulate(np.maximum(times_ns, before_ns))
        self._last = int(numbers[-1]), int(times_ns[-1])
        return PointBlock(
            numbers,
            times_ns,
            poses.xyz_mm,
            poses.ijk,
            poses.angles_rad,
            poses.counts,
            poses.quality,
            covariances_mm2,
        )

    def _decide(self, until_ns: int | None) -> None:
        """Select from instants that waited for edges, up to a time, or all."""
        while self._undecided:
            piece = self._undecided.popleft()
            instants = piece.instants
            n = len(instants)
            if until_ns is not None:
                n = int(np.searchsorted(instants.time_ns, until_ns, side="right"))
            if n:
                self._decided_ns = int(instants.time_ns[n - 1]) + 1
                self._select(replace(piece, instants=instants.rows(slice(0, n))))
            if n < len(instants):
                undecided = replace(piece, instants=instants.rows(slice(n, None)))
                self._undecided.appendleft(undecided)
                break

    def _select(self, piece: _Piece) -> None:
        if piece.model is not self._model:
            self._flush()
            self._selection.break_interpolation()
            self._model = piece.model
        if piece.alignment is not self._alignment:
            self._flush()
            self._alignment = piece.alignment
        points = self._selection.points(piece.instants)
        if len(points):
            self._waiting.append(points)

    def _flush(self, *, last: bool = False) -> None:
        blocks, self._waiting = self._waiting, []
        if blocks:
            points = blocks[0] if len(blocks) == 1 else PointBlock.joined(blocks)
            # A message's numbers are consecutive: a gap begins a new message. After a
            # stall many points arrive at once: no message grows beyond its bound.
            n = len(points)
            bounds = [*range(0, n, MAX_POINTS), n]
            # Nor is a covariance withheld because that of a neighbour is unknown.
            are_unknown = np.isnan(points.covariance_mm2).any(axis=1)
            breaks = (np.diff(points.seq) != 1) | np.diff(are_unknown)
            bounds = sorted({*bounds, *(np.flatnonzero(breaks) + 1).tolist()})
            for start, end in pairwise(bounds):
                final = last and end == bounds[-1]
                self._publish(points.rows(slice(start, end)), last=final)
        elif last:
            last_ns = self._last[1] if self._last else self._clock.monotonic_ns()
            self._publish(
                _empty_block(self._model.encoders.n_joints, last_ns), last=True
            )

    def _publish(self, points: PointBlock, *, last: bool) -> None:
        message = self._message(points, self._selection.next_number if last else None)
        n = len(points)
        if self._offer(message, lambda: self._drop_published(message.scan, n)):
            self.published_points += n
        else:
            self._dropped += n
            self.dropped_points += n

    def _message(self, points: PointBlock, total: int | None) -> Scan:
        """Make the next message, of consecutive points, or an empty one at the end.

        The last one has the total number of points, lost and dropped ones included.
        """
        model, alignment, n = self._model, self._alignment, len(points)
        mode = self._plan.mode
        first = int(points.seq[0]) if n else self._next
        end = max(first + n, total or 0)
        self._lost += first - self._next + end - (first + n)
        self._next = end
        quality = points.quality | self._step_flags(points.time_ns[:n])
        self._in_doubt += int(np.count_nonzero(quality & ~np.uint32(REMARKS)))
        begin_ns = int(points.time_ns[0])
        return Scan(
            session=self.session,
            scan=self._plan.id,
            seq=first,
            arm=model.name,
            model=model.digest,
            mode=mode,
            rate_hz=self._plan.rate_hz if mode == "time" else None,
            probe_radius_mm=model.probe_radius_mm,
            time_ns=self._clock.to_utc_ns(begin_ns),
            dtime_ns=np.maximum.accumulate(points.time_ns[:n] - begin_ns),
            xyz_mm=points.xyz_mm,
            ijk=points.ijk,
            angles_rad=points.angles_rad,
            counts=points.counts,
            part_xyz_mm=None
            if alignment is None
            else alignment.transform_mm(points.xyz_mm),
            covariance_mm2=None
            if np.isnan(points.covariance_mm2[:n]).any()
            else points.covariance_mm2,
            quality=quality,
            dropped=self._dropped,
            lost=self._lost,
            last=total is not None,
            total=total,
            in_doubt=self._in_doubt,
        )

    def _step_flags(self, times_ns: Integers) -> Bits:
        """Flag points that waited here while UTC was set, or the host slept."""
        offset_ns = self._clock.utc_offset_ns()
        if abs(offset_ns - self._utc_offset_ns) > STEP_NS:
            self._stepped_ns = self._clock.monotonic_ns()
        self._utc_offset_ns = offset_ns
        are_earlier = times_ns < self._stepped_ns
        return np.uint32(QualityFlag.TIME_UNCERTAIN) * are_earlier.astype(np.uint32)


def _empty_block(n_joints: int, time_ns: int) -> PointBlock:
    return PointBlock(
        np.zeros(0, np.int64),
        np.array([time_ns], dtype=np.int64),
        np.zeros((0, 3)),
        np.zeros((0, 3)),
        np.zeros((0, n_joints)),
        np.zeros((0, n_joints), np.int64),
        np.zeros(0, np.uint32),
        np.zeros((0, 6)),
    )
