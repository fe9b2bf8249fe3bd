"""The truth as JSON lines: one per input edge, one summary at the end."""

import json
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from simulator.course import Course
from simulator.edges import LatchedEdge
from simulator.script import ScriptEvent


class TruthLog:
    """Writes what really was; lines are flushed as they come.

    Args:
        path: Of the file, None to write nothing.
        course: Of the true arm; None in a replay.
    """

    def __init__(self, path: Path | None, course: Course | None) -> None:
        self._course = course
        self._file = None if path is None else path.open("w", encoding="utf-8")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._file is not None:
            self._file.close()

    def edge(
        self,
        device: str,
        seq: int,
        edge: LatchedEdge,
        *,
        event: ScriptEvent | None,
        script_s: float,
    ) -> None:
        """Write an edge."""
        if self._file is None:
            return
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
        if event is not None:
            line |= {
                "input_name": event.input_name,
                "artefact": event.artefact,
                "feature": event.feature,
                "surface_mm": event.surface_mm,
                "normal": event.normal,
            }
        self._write(line)

    def summary(self, totals: Mapping[str, Any]) -> None:
        """Write the last line."""
        self._write({"event": "summary", **totals})

    def _write(self, line: Mapping[str, Any]) -> None:
        if self._file is not None:
            self._file.write(json.dumps(line) + "\n")
            self._file.flush()
