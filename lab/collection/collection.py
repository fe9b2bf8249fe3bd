"""A campaign while it is collected: what is touched, and the files that say so.

`collected.jsonl` beside the campaign is written first, a line a point or retraction,
and is on the disk before a point counts; `poses.csv` is made anew from it each time.
So a collection resumes where it was, however it ended.
"""

import csv
import io
import json
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from traverse.lab.campaign.campaign_file import CampaignFile
from traverse.lab.collection.plan import PlanFile, Target
from traverse.lab.report.provenance import (
    ReportSource,
    digest_of_files,
    report_provenance,
)
from traverse.plurals import counted
from traverse.protocol.messages import Point
from traverse.strict_toml.files import bytes_of, text_of
from traverse.strict_toml.problems import FileError, Problem, shown
from traverse.strict_toml.writing import write_atomically

JOURNAL = "collected.jsonl"
CAMPAIGN = "campaign.toml"
_SCHEMA_LINE = re.compile(r"^schema\s*=.*\n", re.MULTILINE)
_DIGEST = re.compile("[0-9a-f]{64}")


_Triple = Annotated[list[float], Field(min_length=3, max_length=3)]


@dataclass(frozen=True, slots=True)
class CollectedTouch:
    """One collected point; lists have an entry a joint.

    Attributes:
        time_ns: UTC.
        approach: -1, 0, +1; None if the motion is unknown.
        speed_rad_s: None likewise.
        direction: towards the material; None if unknown.
        xyz_mm: as the daemon computed it, for the running figures.
        model: digest of the daemon's arm file; empty in older collections.
    """

    __pydantic_config__: ClassVar = ConfigDict(
        strict=True, extra="forbid", allow_inf_nan=False
    )

    id: str
    session: str
    seq: int
    time_ns: Annotated[int, Field(ge=0, lt=2**63)]
    artefact: str
    feature: str
    angles_rad: list[float]
    temperature_c: float | None
    approach: list[int] | None
    speed_rad_s: list[float] | None
    direction: _Triple | None
    xyz_mm: _Triple
    model: str = ""


@dataclass(frozen=True, slots=True)
class _Retraction:
    """A point that does not count any more, by its id."""

    __pydantic_config__ = CollectedTouch.__pydantic_config__

    retracts: str


_LINE: TypeAdapter[CollectedTouch | _Retraction] = TypeAdapter(
    CollectedTouch | _Retraction
)


@dataclass(slots=True)
class Collection:
    """Collected touches of a campaign.

    Args:
        joint_names: of the arm, from the base outwards.
        targets: required touches, in order; a feature may recur, counted up.

    Attributes:
        touches: by id, in the order of time.
    """

    file: CampaignFile
    folder: Path
    joint_names: Sequence[str]
    targets: tuple[Target, ...]
    plan: PlanFile | None = None
    touches: dict[str, CollectedTouch] = field(default_factory=dict)
    _retracted: set[str] = field(default_factory=set)

    def resume(self) -> None:
        """Resume an earlier collection.

        Raises:
            FileError: the files are not of this collection; nothing is changed.
        """
        journal, table = self.folder / JOURNAL, self.folder / self.file.poses
        if not journal.exists():
            if table.exists():
                message = (
                    f"is there, and was not written by `traverse collect` ({JOURNAL} "
                    "is missing); move it away, or name another file in the campaign"
                )
                raise FileError(table, message)
            return
        problems = []
        lines = bytes_of(journal).split(b"\n")
        if lines[-1]:
            # Torn by a loss of power: it was never acknowledged.
            with journal.open("r+b") as file:
                file.truncate(sum(len(line) + 1 for line in lines[:-1]))
        for number, line in enumerate(lines[:-1], 1):
            try:
                self._apply(_LINE.validate_json(line))
            except ValidationError:
                message = "is no line that `traverse collect` writes"
            except ValueError as error:
                message = f"is no point of this collection: {error}"
            else:
                continue
            message += "; mend it, or move the file and the poses away and begin anew"
            problems.append(Problem(f"line {number}", message))
        if problems:
            raise FileError(journal, problems)
        self._write_table()

    def take(self, touch: CollectedTouch) -> bool:
        """Store a point, also on disk; False if it is stored already."""
        if touch.id in self.touches or touch.id in self._retracted:
            return False
        self._keep(touch)
        return True

    def take_all(self, touches: Iterable[CollectedTouch]) -> None:
        self._keep(*(touch for touch in touches if touch.id not in self.touches))

    def retract(self, point_id: str) -> bool:
        """Take a point back; False where it is not of this collection."""
        if point_id not in self.touches:
            return False
        self._keep(_Retraction(point_id))
        return True

    def count(self, target: Target) -> int:
        return len(self.of(target.artefact, target.feature))

    def of(self, artefact: str, feature: str | None = None) -> list[CollectedTouch]:
        return [
            touch
            for touch in self.touches.values()
            if touch.artefact == artefact and feature in (None, touch.feature)
        ]

    def unfinished(self) -> list[Target]:
        """Targets that lack touches, in order."""
        return [t for t in self.targets if self.count(t) < t.wanted]

    def target(self, artefact: str, feature: str) -> Target | None:
        key = (artefact, feature)
        return next((t for t in self.targets if (t.artefact, t.feature) == key), None)

    def _keep(self, *entries: CollectedTouch | _Retraction) -> None:
        lines = [json.dumps(asdict(entry), allow_nan=False) + "\n" for entry in entries]
        with (self.folder / JOURNAL).open("a", encoding="utf-8") as file:
            file.write("".join(lines))
            file.flush()
            os.fsync(file.fileno())
        for entry in entries:
            self._apply(entry)
        self._write_table()

    def _apply(self, entry: CollectedTouch | _Retraction) -> None:
        if isinstance(entry, _Retraction):
            if self.touches.pop(entry.retracts, None) is None:
                raise ValueError(f"{shown(entry.retracts)} was not taken before")
            self._retracted.add(entry.retracts)
            return
        n = len(self.joint_names)
        for values in (entry.angles_rad, entry.approach, entry.speed_rad_s):
            if values is not None and len(values) != n:
                raise ValueError(
                    f"{counted(len(values), 'value')}, but the arm has "
                    f"{counted(n, 'joint')}"
                )
        if self.target(entry.artefact, entry.feature) is None:
            name = f"{entry.artefact} {entry.feature}".strip()
            raise ValueError(f"{name!r} is not in the campaign")
        self.touches[entry.id] = entry

    def _note_origin(self, first: CollectedTouch) -> None:
        """Write into the campaign when it began, and with which arm file.

        Certificates state the dates, and chains of evidence lead to the arm.
        """
        start = datetime.fromtimestamp(first.time_ns // 10**9, UTC)
        origin: dict[str, Any] = {"start_utc": start}
        if _DIGEST.fullmatch(first.model):
            origin["arm_digest"] = first.model
        origin = {k: v for k, v in origin.items() if getattr(self.file, k) is None}
        path = self.folder / CAMPAIGN
        if not origin or not path.is_file():
            return
        self.file = self.file.model_copy(update=origin)
        lines = "".join(
            f"{key} = {value:%Y-%m-%dT%H:%M:%SZ}\n"
            if isinstance(value, datetime)
            else f'{key} = "{value}"\n'
            for key, value in origin.items()
        )
        text = text_of(path)
        write_atomically(path, _SCHEMA_LINE.sub(rf"\g<0>{lines}", text, count=1))

    def _write_table(self) -> None:
        text = io.StringIO()
        names = self.joint_names
        table = csv.writer(text, lineterminator="\n")
        table.writerow(
            [
                *("time_s", "artefact", "feature"),
                *(f"{name}_rad" for name in names),
                "temperature_c",
                *(f"{name}_approach" for name in names),
                *(f"{name}_speed_rad_s" for name in names),
                *(f"direction_{c}" for c in "xyz"),
            ]
        )
        touches = sorted(self.touches.values(), key=lambda touch: touch.time_ns)
        if touches:
            self._note_origin(touches[0])
        start = self.file.start_utc
        begin_ns = 0 if start is None else round(start.timestamp() * 1e6) * 1000
        nothing: list[float | None] = [None] * len(names)
        for touch in touches:
            table.writerow(
                [
                    f"{(touch.time_ns - begin_ns) * 1e-9:.6f}",
                    touch.artefact,
                    touch.feature,
                    *map(repr, touch.angles_rad),
                    touch.temperature_c,
                    *(touch.approach or nothing),
                    *(touch.speed_rad_s or nothing),
                    *(touch.direction or (None, None, None)),
                ]
            )
        write_atomically(self.folder / self.file.poses, text.getvalue())


def touch_of(
    point: Point,
    target: Target,
    approach: np.ndarray | None,
    speed_rad_s: np.ndarray | None,
) -> CollectedTouch:
    """A captured point as one touch of a target."""
    direction = None
    # Along the shank is assumed, the other methods have measured the direction.
    if point.surface_mm is not None and point.compensation != "shank":
        way_mm = np.subtract(point.surface_mm, point.xyz_mm)
        length_mm = float(np.linalg.norm(way_mm))
        if length_mm > 0.0:
            direction = (way_mm / length_mm).tolist()
    return CollectedTouch(
        id=point.id,
        session=point.session,
        seq=point.seq,
        time_ns=point.time_ns,
        artefact=target.artefact,
        feature=target.feature,
        angles_rad=list(point.angles_rad),
        temperature_c=point.temperature_c,
        approach=None if approach is None else [int(a) for a in approach],
        speed_rad_s=None if speed_rad_s is None else speed_rad_s.tolist(),
        direction=direction,
        xyz_mm=list(point.xyz_mm),
        model=point.model,
    )


def collection_report(collection: Collection) -> dict[str, Any]:
    """Touches of every feature, and whether they reach the target."""
    # The last target of a recurring feature includes all its touches.
    last = {(target.artefact, target.feature): target for target in collection.targets}
    table = collection.folder / collection.file.poses
    files = [path for path in (collection.folder / CAMPAIGN, table) if path.is_file()]
    source = ReportSource(collection.folder.resolve().name, digest_of_files(files))
    return {
        "campaign": str(collection.folder),
        "provenance": report_provenance(source).values,
        "poses": len(collection.touches),
        "complete": not collection.unfinished(),
        "features": [
            {
                "artefact": target.artefact,
                "feature": target.feature or None,
                "touches": collection.count(target),
                "wanted": target.wanted,
            }
            for target in last.values()
        ],
    }
