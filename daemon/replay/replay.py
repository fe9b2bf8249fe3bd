"""A recording goes through the same pipeline again, by its own times.

Steps are taken as they were, each at its recorded instant: a point depends on nothing
else. Blocks of samples may be cut, or joined where nothing lies between, as wanted.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from traverse.daemon.recorder.file import STEPS
from traverse.daemon.recorder.recorded_inputs import read_recorded_inputs
from traverse.daemon.recorder.snapshot import WARM_UP_NS
from traverse.daemon.replay.compare import PointComparison, ScanComparison
from traverse.daemon.replay.harness import ReplayClock, ReplayHarness
from traverse.daemon.replay.result import ReplayResult
from traverse.drivers.base.delivery_maps import delivery_from_map
from traverse.drivers.base.values import CountSamples
from traverse.kinematics.kernel.choice import KERNEL
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import Point, Scan
from traverse.recording.maps import bytes_to_map
from traverse.recording.run_reader import RunReader
from traverse.recording.run_writer import Entry
from traverse.recording.views import bytes_to_cloud


class Replay:
    """Replays one recording; needs a running event loop.

    Args:
        reader: of the recording, at its beginning.
        block: blocks of samples are cut to so many, or joined up to so many; None:
            as they came.
        take_point: called with each point.
        take_scan: called with each block of a scan.
    """

    def __init__(
        self,
        reader: RunReader,
        block: int | None = None,
        *,
        take_point: Callable[[Point], object] = lambda point: None,
        take_scan: Callable[[Scan], object] = lambda scan: None,
    ) -> None:
        self._reader = reader
        self._block = block
        self._take_point = take_point
        self._take_scan = take_scan
        self._clock = ReplayClock()
        self._bench: ReplayHarness | None = None
        self._points: PointComparison | None = None
        self._scans: ScanComparison | None = None
        self._sure_ns = 0
        self._joined: list[tuple[int, CountSamples]] = []
        self._samples = 0
        self._gaps = 0

    def run(self) -> ReplayResult:
        """Take all steps.

        Raises:
            ValueError: the recording breaks a rule of its own.
            OSError: it cannot be read.
        """
        try:
            for entry in self._reader:
                self._take(entry)
            self._flush()
        except (KeyError, TypeError, AttributeError, IndexError, MessageError) as error:
            raise ValueError(
                f"{self._reader.path}: a step makes no sense: {error!r}; was it "
                "recorded by this version?"
            ) from error
        finally:
            if self._bench is not None:
                self._bench.close()
        points, scans = self._points, self._scans
        if points is None or scans is None:
            tear = f" ({self._reader.tear})" if self._reader.tear else ""
            raise ValueError(f"{self._reader.path}: no state to begin with{tear}")
        missing_scan = scans.settle()
        return ReplayResult(
            points=points.sure,
            early=points.early,
            scans=scans.tally,
            missing=points.missing,
            missing_scan=missing_scan,
            left_out=scans.left_out,
            new=points.new,
            not_kept=points.not_kept,
            excused=points.excused,
            samples=self._samples,
            gaps=self._gaps,
            kernel_then=self._reader.about.get("kernel", "?"),
            kernel_now=KERNEL,
            tolerance_mm=points.tolerance_mm,
            tear=self._reader.tear,
        )

    def _take(self, entry: Entry) -> None:
        match entry.topic.split("/"):
            case ["point"]:
                if self._points is not None:
                    self._points.was(Point.model_validate_json(entry.content))
            case ["cloud"]:
                if self._scans is not None:
                    self._scans.was(*bytes_to_cloud(entry.content))
            case ["device", _, _]:
                self._deliver(entry)
            case [topic] if topic == STEPS:
                table = bytes_to_map(entry.content)
                if table["is"] == "state":
                    self._flush()
                    self._begin(entry, table)
                elif self._bench is not None:
                    self._flush()
                    self._set_clock(entry, table)
                    self._step(self._bench, table)

    def _set_clock(self, entry: Entry, table: Mapping[str, Any]) -> None:
        self._clock.now_ns = table["at_ns"]
        self._clock.offset_ns = entry.log_ns - table["at_ns"]

    def _begin(self, entry: Entry, table: Mapping[str, Any]) -> None:
        """Go on from a state, where nothing is known of the time before."""
        if self._bench is not None:
            return
        self._set_clock(entry, table)
        state = table["value"]
        configuration, model = read_recorded_inputs(self._reader.files, state["probe"])
        bench = ReplayHarness(
            configuration,
            model,
            self._clock,
            take_point=self._take_new,
            take_scan=self._take_new_scan,
        )
        self._bench = bench
        bench.resume(state)
        self._sure_ns = 0 if state["fresh"] else table["at_ns"] + WARM_UP_NS
        if self._points is None:
            reach_mm = float(
                np.linalg.norm(model.geometry.links_mm, axis=1).sum()
                + np.abs(model.geometry.origin_mm).max()
            )
            is_recut = self._block is not None
            self._points = PointComparison(reach_mm, is_recut=is_recut)
            self._scans = ScanComparison(self._points.tolerance_mm)

    def _step(self, bench: ReplayHarness, table: Mapping[str, Any]) -> None:
        match table["is"]:
            case "passed":
                bench.measuring.process_timeouts()
            case "asked" if table["what"] == "not_kept":
                if self._points is not None:
                    self._points.not_kept += 1
            case "asked":
                if table["what"] == "start_scan" and self._scans is not None:
                    self._scans.begin(table["value"]["id"])
                bench.ask(table["what"], table["value"])
            case "files":
                bench.use(
                    *read_recorded_inputs(self._reader.files, table["value"]["probe"])
                )
            case "gap":
                self._gaps += 1
                if self._scans is not None:
                    self._scans.lose()
                bench.close()
                self._bench = None

    def _deliver(self, entry: Entry) -> None:
        if self._bench is None:
            return
        table = bytes_to_map(entry.content)
        delivery = delivery_from_map(table)
        if isinstance(delivery, CountSamples):
            self._samples += len(delivery.seq)
            self._join(entry, table, delivery)
            return
        self._flush()
        self._set_clock(entry, table)
        self._bench.take(delivery)

    def _join(
        self, entry: Entry, table: Mapping[str, Any], samples: CountSamples
    ) -> None:
        """Take samples now, or with those that follow."""
        bench, block = self._bench, self._block
        if bench is None:
            return
        if block is None or len(bench.measuring.model.devices) > 1:
            # Where devices wait for each other, times of steps count, too.
            self._set_clock(entry, table)
            for part in _cut(samples, block):
                bench.take(part)
            return
        waiting = self._joined
        if waiting and (
            waiting[-1][1].stream != samples.stream
            or waiting[-1][1].device != samples.device
            or self._clock.offset_ns != entry.log_ns - table["at_ns"]
        ):
            self._flush()
        self._set_clock(entry, table)
        waiting.append((table["at_ns"], samples))
        if sum(len(s.seq) for _, s in waiting) >= block:
            self._flush()

    def _flush(self) -> None:
        """Take the samples that waited to be joined."""
        waiting, self._joined = self._joined, []
        if waiting and self._bench is not None:
            joined = CountSamples.joined([samples for _, samples in waiting])
            for part in _cut(joined, self._block):
                self._bench.take(part)

    def _take_new(self, point: Point) -> None:
        if self._points is not None:
            now_ns = point.time_ns - self._clock.offset_ns
            self._points.is_now(point, early=now_ns < self._sure_ns)
        self._take_point(point)

    def _take_new_scan(self, scan: Scan) -> None:
        if self._scans is not None:
            self._scans.is_now(scan)
        self._take_scan(scan)


def _cut(samples: CountSamples, block: int | None) -> Iterator[CountSamples]:
    n = len(samples.seq)
    if block is None or n <= block:
        yield samples
        return
    for start in range(0, n, block):
        yield samples.rows(slice(start, start + block))
