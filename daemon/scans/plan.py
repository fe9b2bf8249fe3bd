"""Plan of a requested scan and its stream."""

import uuid
from dataclasses import dataclass, replace

import numpy as np

from traverse.daemon.config.schema import ScanSection
from traverse.daemon.errors import RequestRefusedError
from traverse.kinematics.filters import PointFilter
from traverse.kinematics.filters.sections import Sections
from traverse.kinematics.filters.thinning import Distance
from traverse.protocol.messages import ScanArgs
from traverse.protocol.messages.scan import ScanMode


@dataclass(frozen=True, slots=True)
class ScanPlan:
    """A requested scan.

    Attributes:
        rate_hz: instants per second that may become points; in mode "time" all do.
        every: the device streams at ``every * rate_hz``, of which each ``every``-th
            sample counts, so that slow scans still follow the joints' turns.
        read_hz: the device streams at this rate, and instants of the scan lie between
            its samples; 0: they are samples.
        spacing_mm: of points or planes, in modes "distance" and "planes".
        normal, offset_mm: of the planes in mode "planes".
        held: only while a button is held.
    """

    id: str
    rate_hz: float
    every: int
    mode: ScanMode = "time"
    spacing_mm: float = 0.0
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)
    offset_mm: float = 0.0
    held: bool = False
    read_hz: float = 0.0

    @property
    def device_rate_hz(self) -> float:
        return self.read_hz or self.rate_hz * self.every

    def on_stream(self, rate_hz: float) -> "ScanPlan":
        """Return the scan on a stream whose rate is another than was requested."""
        if self.read_hz:
            return replace(self, read_hz=rate_hz)
        return replace(self, rate_hz=rate_hz / self.every)

    def selection(self) -> PointFilter | None:
        """Return the filter of the mode; None for all samples."""
        if self.mode == "time":
            return None
        if self.mode == "distance":
            return Distance(self.spacing_mm)
        return Sections(self.normal, self.spacing_mm, self.offset_mm)


RATE_TOLERANCE = 0.05
"""Tolerance above the largest rate, which is measured: 100 Hz may be 99.8 Hz."""
ROUNDING = 1e-9


def plan_scan(
    rate_hz: float,
    tracking_rate_hz: float,
    largest_hz: float = np.inf,
    *,
    reads_in_turn: bool = False,
) -> ScanPlan:
    """Plan a timed scan at ``rate_hz`` on a stream of at least the tracking rate.

    On a slower device, none of whose multiples of ``rate_hz`` is about the tracking
    rate, one of two things has to give way. Counts that are interpolated at any rate
    (``reads_in_turn``) are read at the tracking rate, and the scan's instants lie
    between: what is read seldom shows neither a freeze nor a jump. Counts of one
    instant stay what they are: the stream has the largest multiple, more than half of
    the largest rate, and the scan the nearest rate that this allows.
    """
    every = max(1, int(np.ceil(tracking_rate_hz / rate_hz)))
    most_hz = largest_hz * (1.0 + RATE_TOLERANCE)
    if every > 1 and every * rate_hz > most_hz:
        every = max(1, int(most_hz / rate_hz))
        least_hz = tracking_rate_hz * (1.0 - RATE_TOLERANCE)
        if reads_in_turn and every * rate_hz < least_hz:
            return ScanPlan(_new_id(), rate_hz, 1, read_hz=tracking_rate_hz)
    if largest_hz < every * rate_hz <= most_hz:
        rate_hz = largest_hz / every
    return ScanPlan(_new_id(), rate_hz, every)


def _new_id() -> str:
    return uuid.uuid4().hex[:12]


def requested_scan(
    args: ScanArgs,
    settings: ScanSection,
    *,
    largest_hz: float,
    tracking_rate_hz: float,
    reads_in_turn: bool = False,
) -> ScanPlan:
    """Plan the scan that a command requests, with defaults from the settings.

    Rates [Hz]: the largest of every device, and the slowest that follows the joints. A
    configured rate is reduced as necessary. ``reads_in_turn``: see `plan_scan`.

    Raises:
        RequestRefusedError: the rate is impossible, or values are inconsistent.
    """
    if args.mode == "time":
        rate_hz = args.rate_hz or min(settings.rate_hz, largest_hz)
        plan = plan_scan(
            rate_hz, tracking_rate_hz, largest_hz, reads_in_turn=reads_in_turn
        )
    else:  # as dense as configured: what is not read cannot be selected
        rate_hz = args.rate_hz or min(settings.dense_rate_hz, largest_hz)
        plan = plan_scan(max(rate_hz, tracking_rate_hz), 0.0, largest_hz)
    plan = replace(
        plan,
        mode=args.mode,
        spacing_mm=args.spacing_mm or 0.0,
        normal=args.normal or plan.normal,
        offset_mm=args.offset_mm,
        held=args.held,
    )
    try:
        plan.selection()
    except ValueError as error:
        text = "correct the arguments and send again"
        raise RequestRefusedError("command.bad_args", str(error), text) from error
    if plan.device_rate_hz > largest_hz * (1.0 + ROUNDING):
        raise RequestRefusedError(
            "scan.rate",
            f"{plan.rate_hz:g} Hz is more than the {largest_hz:g} Hz possible",
            f"request {largest_hz:g} Hz or less",
        )
    return plan
