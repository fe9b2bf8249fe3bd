"""Results of a replay."""

from dataclasses import dataclass

from traverse.daemon.replay.compare import Tally


@dataclass(frozen=True, slots=True)
class ReplayResult:
    """Results of a replay.

    Attributes:
        points: that do not depend on the time before the recording.
        early: of the first seconds of a recording that began in the middle.
        scans: points of scans that are in the recording from their beginning.
        missing, missing_scan: published then, not given by the replay.
        left_out: points of scans that had begun before the recording.
        new: given by the replay, not published then.
        not_kept: refused by the disk then.
        excused: see `traverse.daemon.replay.compare.PointComparison`.
        samples: sets of counts that were replayed.
        gaps: how often something is missing in the recording.
        kernel_then, kernel_now: what computed.
        tolerance_mm: by which another kernel may differ.
        tear: where the file ends before its end, or None.
    """

    points: Tally
    early: Tally
    scans: Tally
    missing: int
    missing_scan: int
    left_out: int
    new: int
    not_kept: int
    excused: int
    samples: int
    gaps: int
    kernel_then: str
    kernel_now: str
    tolerance_mm: float
    tear: str | None

    @property
    def holds(self) -> bool:
        """The claim: the same bits with the same kernel, else within the tolerance."""
        is_same_kernel = self.kernel_then == self.kernel_now
        compared = (self.points, self.scans)
        if is_same_kernel:
            agree = all(tally.same == tally.n for tally in compared)
        else:
            agree = all(tally.within == tally.n for tally in compared)
        return agree and not self.missing and not self.missing_scan
