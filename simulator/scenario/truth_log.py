"""The truth as JSON lines: input edges, readings, one summary at the end."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np

from traverse.simulator.scenario.course import Course
from traverse.simulator.scenario.signals import LatchedEdge
from traverse.simulator.scenario.wiring import ScriptClock

READINGS_TOGETHER = 64  # that are worked out and written at a time


class TruthLog:
    """Writes the truth; edges are flushed as they occur.

    Args:
        path: of the file, None to write nothing.
        course: of the true arm; None in a replay.
        origin_ns: the host's monotonic clock at time 0 of the simulation; None if
            that has a time of its own.
        readings: write each reading of an encoder that is polled by itself.
    """

    def __init__(
        self,
        path: Path | None,
        course: Course | None,
        clock: ScriptClock,
        *,
        origin_ns: int | None = None,
        readings: bool = False,
    ) -> None:
        self._course = course
        self._clock = clock
        self._origin_ns = origin_ns
        self._file = None if path is None else path.open("w", encoding="utf-8")
        self._takes_readings = readings and path is not None
        self._readings: list[dict[str, Any]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._write_readings()
            self._file.close()

    def edge(self, device: str, seq: int, edge: LatchedEdge) -> None:
        if self._file is None:
            return
        self._write_readings()
        script_s = self._clock.script_s(edge.time_s)
        line: dict[str, Any] = {
            "event": "edge",
            "device": device,
            "seq": seq,
            "time_s": edge.time_s,
            "script_s": script_s,
            "ticks": edge.ticks,
            "input": edge.input_number,
            "level": edge.level,
            "counts": edge.counts.tolist(),
            "angles_rad": None,
            "centre_mm": None,
            "shank": None,
        }
        if self._course is not None:
            now_s = np.array([script_s])
            centres, shanks = self._course.probe(now_s)
            line["angles_rad"] = self._course.readings_rad(now_s)[0].tolist()
            line["centre_mm"] = np.asarray(centres[0]).tolist()
            line["shank"] = np.asarray(shanks[0]).tolist()
        if (event := edge.event) is not None:
            line |= {
                "input_name": event.input_name,
                "artefact": event.artefact,
                "feature": event.feature,
                "surface_mm": event.surface_mm,
                "normal": event.normal,
            }
        self._write(line)

    def reading(
        self, device: str, channel: int, time_s: float, count: int, status: int
    ) -> None:
        """Note a reading; readings are written in batches."""
        if not self._takes_readings:
            return
        line = {
            "event": "reading",
            "device": device,
            "channel": channel,
            "time_s": time_s,
            "script_s": self._clock.script_s(time_s),
            "monotonic_ns": None,
            "count": count,
            "status": status,
            "angles_rad": None,
        }
        if self._origin_ns is not None:
            line["monotonic_ns"] = self._origin_ns + round(1e9 * time_s)
        self._readings.append(line)
        if len(self._readings) >= READINGS_TOGETHER:
            self._write_readings()

    def dropped(
        self, device: str, n_samples: int, time_s: float, stood_s: float
    ) -> None:
        """Write that samples had no room in a device's buffer."""
        self._write_readings()
        self._write(
            {
                "event": "dropped",
                "device": device,
                "samples": n_samples,
                "time_s": time_s,
                "script_s": self._clock.script_s(time_s),
                "stood_s": stood_s,
            }
        )

    def summary(self, totals: Mapping[str, Any]) -> None:
        self._write_readings()
        self._write({"event": "summary", **totals})

    def _write_readings(self) -> None:
        if self._readings and self._course is not None:
            at_s = np.array([line["script_s"] for line in self._readings])
            for line, angles in zip(
                self._readings, self._course.readings_rad(at_s), strict=True
            ):
                line["angles_rad"] = angles.tolist()
        for line in self._readings:
            self._write(line)
        self._readings.clear()

    def _write(self, line: Mapping[str, Any]) -> None:
        if self._file is not None:
            self._file.write(json.dumps(line) + "\n")
            self._file.flush()
