"""A campaign: what was measured for identification or diagnosis, as arrays."""

import csv
import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from traverse.arrays import Booleans, Floats, Integers
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.base.context import Span, utc_ns
from traverse.kinematics.effects.base.correction import Correction
from traverse.lab.artefacts.artefact import Artefact, Touches
from traverse.lab.artefacts.points import Points
from traverse.lab.campaign.campaign_file import (
    NONE_STATED,
    CampaignFile,
    Circumstances,
    Tool,
    example_problems,
    read_campaign_file,
)
from traverse.lab.campaign.pose_table import PoseTable, read_pose_table
from traverse.lab.campaign.poses import Poses, without_copies
from traverse.lab.campaign.prior import Prior
from traverse.lab.report.provenance import (
    ReportProvenance,
    ReportSource,
    report_provenance,
)
from traverse.protocol.printable import spreadsheet_cell
from traverse.strict_toml.files import bytes_of
from traverse.strict_toml.problems import FileError, Problem

_CHUNK_BYTES = 1 << 20
# When a campaign that does not say when it began is taken to have begun.
_NO_START = datetime(2000, 1, 1, tzinfo=UTC)
_MOST_PROBLEMS = 20
_MARGIN = timedelta(milliseconds=1)
_ONE_TOOL = (
    "only `traverse identify`, `diagnose`, `predict` and `verify` take several "
    "tools; take the poses of one, and leave the column out"
)
_NO_ORIENTATIONS = (
    "only `traverse identify`, `diagnose` and `predict` take measured "
    "orientations; leave these columns out"
)


# Of recordings.
SUFFIX = ".mcap"


@dataclass(frozen=True, slots=True, eq=False)
class Campaign:
    """Poses of a campaign, with the artefacts' certificates.

    Attributes:
        artefacts: As in the file, in its order.
        feature_names: The features of every artefact, in the order of the indices.
        start_utc: From where time_s counts.
        time_is_order: time_s counts poses, not seconds.
        gravity_m_s2: Override of the arm's, or None.
        encoder_rad: A-priori standard deviation of a reading, or None.
        contact_mm: A-priori standard deviation of a contact, or None.
        orientation_rad: Of a measured orientation, about each axis, or None.
        name: Of its folder; empty if there was none.
        operator: Who measured, or None.
        place: Where, or None.
        circumstances: As in the campaign file.
        digest: SHA-256 over the files, hexadecimal; empty if there were none.
        is_stream: Poses are the samples of a recording: their errors are correlated.
        notes: What is not as it should be, but no reason to refuse.
        tools: Others than the arm's own, as `Poses.tools` numbers them from 1 on.
        prior: What the arm's family says of it, or None.
    """

    artefacts: tuple[Artefact, ...]
    feature_names: tuple[tuple[str, ...], ...]
    joint_names: tuple[str, ...]
    poses: Poses
    start_utc: datetime | None = None
    time_is_order: bool = False
    gravity_m_s2: tuple[float, float, float] | None = None
    encoder_rad: float | None = None
    contact_mm: float | None = None
    orientation_rad: float | None = None
    name: str = ""
    operator: str | None = None
    place: str | None = None
    circumstances: Circumstances = NONE_STATED
    digest: str = ""
    is_stream: bool = False
    notes: tuple[str, ...] = ()
    tools: tuple[Tool, ...] = ()
    prior: Prior | None = None

    @property
    def start(self) -> datetime:
        return self.start_utc or _NO_START

    def provenance(
        self, computed_by: str | None = None, when: datetime | None = None
    ) -> ReportProvenance:
        """Make the provenance of a report about it; see `report_provenance`."""
        source = ReportSource(self.name, self.digest)
        return report_provenance(source, computed_by, when)

    @property
    def states_noise(self) -> bool:
        """Whether it states the noise of readings and of contacts."""
        return self.encoder_rad is not None and self.contact_mm is not None

    @property
    def span(self) -> Span:
        """From when to when it lasted, a little wider than the poses.

        Their times are rounded to nanoseconds.
        """
        times_s = self.poses.time_s
        if len(times_s) == 0:
            return self.start, self.start
        first_s, last_s = min(float(times_s.min()), 0.0), float(times_s.max())
        return (
            self.start + timedelta(seconds=first_s) - _MARGIN,
            self.start + timedelta(seconds=last_s) + _MARGIN,
        )

    @property
    def temperature_range_c(self) -> dict[str, float]:
        """The arm's lowest and highest temperature, as keys of the arm file."""
        known_c = self.poses.temperature_c
        if known_c is None or np.isnan(known_c).all():
            return {}
        return {
            "temperature_low_c": float(np.nanmin(known_c)),
            "temperature_high_c": float(np.nanmax(known_c)),
        }

    def touched_cells(self, row: int) -> tuple[str, str]:
        """Write artefact and feature of a pose as cells of a table for people."""
        artefact = int(self.poses.artefacts[row])
        feature = self.feature_names[artefact][int(self.poses.features[row])]
        return spreadsheet_cell(self.artefacts[artefact].id), spreadsheet_cell(feature)

    def write_table(
        self, path: Path, header: Sequence[str], cells: Callable[[int], list[str]]
    ) -> None:
        """Write a CSV table, a line a pose: what was touched, and further cells."""
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["line", "artefact", "feature", *header])
            writer.writerows(
                [line, *self.touched_cells(index), *cells(index)]
                for index, line in enumerate(self.poses.lines.tolist())
            )

    def block(
        self, poses: Poses | None = None, angles_rad: Floats | None = None
    ) -> Block:
        """Put poses into the form that effects ask for.

        Args:
            poses: Some of the campaign's; default all of them.
            angles_rad: Instead of their readings, (n_poses, n_joints).
        """
        chosen = self.poses if poses is None else poses
        elapsed_ns = np.rint(chosen.time_s * 1e9).astype(np.int64)
        gravity = self.gravity_m_s2
        return Block(
            angles_rad=chosen.angles_rad if angles_rad is None else angles_rad,
            speeds_rad_s=chosen.speeds_rad_s,
            approaches=chosen.approaches,
            temperature_c=chosen.temperature_c,
            joint_temperatures_c=chosen.joint_temperatures_c,
            utc_ns=utc_ns(self.start) + elapsed_ns,
            campaign_s=chosen.time_s,
            directions=chosen.directions,
            force_n=chosen.force_n,
            gravity_m_s2=None if gravity is None else np.array(gravity),
        )

    def plausible_values(self, correction: Correction) -> tuple[float, ...]:
        """Return a plausible standard deviation for each parameter, in its unit.

        Orders of magnitude of arms of a metre or two. They decide what a campaign
        cannot say anything about, and never how large an effect is estimated.
        """
        kind = EFFECT_KINDS[correction.kind]
        size = kind.plausible_size(getattr(correction, "order", None))
        if kind.is_size_of_campaign:
            size /= max(float(np.ptp(self.poses.time_s)), 1.0)
        return tuple(
            1.0 if key == kind.phase else size for key in correction.parameters
        )

    def with_poses(self, **columns: Any) -> "Campaign":
        """Put other columns into the poses."""
        return replace(self, poses=replace(self.poses, **columns))

    def without_orientations(self, which: Booleans) -> "Campaign":
        """Forget the orientations of some poses, (n_poses,)."""
        orientations = self.poses.orientations
        if orientations is None:
            return self
        kept = np.where(which[:, np.newaxis], np.nan, orientations)
        return self.with_poses(orientations=kept)

    def with_tools(
        self, vectors_mm: Mapping[str, Floats], *, held: bool = True
    ) -> "Campaign":
        """Hold tools at vectors, (3,), by their names; or only begin there."""
        tools = tuple(
            Tool(
                name=tool.name,
                vector_mm=tuple(known.tolist()),
                held=held or tool.held,
            )
            if (known := vectors_mm.get(tool.name)) is not None
            else tool
            for tool in self.tools
        )
        return replace(self, tools=tools)

    def part(self, rows: Booleans | Integers | slice) -> "Campaign":
        return replace(self, poses=self.poses.part(rows))

    def touches(self, index: int, rows: Integers, radius_mm: float) -> Touches:
        """Return how an artefact was touched in some poses."""
        per_c, reference_c = self.artefacts[index].expansion
        growths = np.zeros(len(rows))
        if self.poses.temperature_c is not None and per_c != 0.0:
            warmer_c = self.poses.temperature_c[rows] - reference_c
            growths = per_c * np.nan_to_num(warmer_c, nan=0.0)
        directions = np.full((len(rows), 3), np.nan)
        if self.poses.directions is not None:
            directions = self.poses.directions[rows]
        lengths_mm, oriented = self.poses.lengths_mm, self.poses.oriented[rows]
        orientations = self.poses.orientations
        return Touches(
            self.poses.features[rows],
            growths,
            directions,
            radius_mm,
            self.feature_names[index],
            None if lengths_mm is None else lengths_mm[rows],
            orientations[rows]
            if orientations is not None and np.any(oriented)
            else None,
        )


def touching_stretches(campaign: Campaign, longest_s: float = np.inf) -> Integers:
    """Number the stretches in which one feature is touched without a gap, (n,).

    From sample to sample there it is not longer than that.
    """
    poses = campaign.poses
    breaks = np.diff(poses.lines) != 1
    breaks |= np.diff(poses.time_s) > longest_s
    breaks |= np.diff(poses.artefacts) != 0
    breaks |= np.diff(poses.features) != 0
    return np.concatenate([[0], np.cumsum(breaks)]).astype(np.int64)


def read_campaign(
    folder: str | Path,
    joint_names: Sequence[str],
    *,
    several_tools: bool = False,
    orientations: bool = False,
) -> Campaign:
    """Read a campaign's folder.

    Args:
        folder: With `campaign.toml` in it.
        joint_names: Of the arm, from the base outwards.
        several_tools: Whether poses may name tools.
        orientations: Whether poses may have measured orientations.

    Raises:
        FileError: With everything that is wrong with a file.
    """
    path = Path(folder) / "campaign.toml"
    file = read_campaign_file(path)
    if problems := example_problems(file):
        raise FileError(path, problems)
    poses = path.parent / file.poses
    features = {artefact.id: artefact.features for artefact in file.artefacts}
    if poses.suffix != SUFFIX and not poses.exists():
        text = f"no poses yet: `traverse collect {path.parent}` writes {poses.name}"
        raise FileError(path, [Problem("poses", text)])
    if poses.suffix == SUFFIX:
        from traverse.lab.campaign.stream_table import (  # noqa: PLC0415 - only recordings need it
            read_stream_table,
        )

        table = read_stream_table(poses, joint_names, features, file.start_utc)
    else:
        tools = [tool.name for tool in file.tools]
        table = read_pose_table(poses, joint_names, features, tools)
        problems = []
        if table.poses.tools is not None and not several_tools:
            problems.append(Problem("tool", _ONE_TOOL))
        if np.any(table.poses.oriented) and not orientations:
            problems.append(Problem("orientation_w", _NO_ORIENTATIONS))
        if problems:
            raise FileError(poses, problems)
    return _campaign(path, file, table, tuple(joint_names))


def _campaign(
    path: Path, file: CampaignFile, table: PoseTable, joint_names: tuple[str, ...]
) -> Campaign:
    poses = table.poses
    _check_lengths(path.parent / file.poses, file, poses)
    _check_orientations(path.parent / file.poses, file, poses)
    is_stream = Path(file.poses).suffix == SUFFIX
    notes = table.notes
    if not is_stream:
        # Samples of an arm at rest are alike.
        poses, places = without_copies(poses, _places(file.artefacts, poses))
        notes = (*notes, *(f"{file.poses}: {note}" for note in places))
    features = poses.features.copy()
    artefacts: list[Artefact] = []
    names: list[tuple[str, ...]] = []
    for index, listed_artefact in enumerate(file.artefacts):
        artefact = listed_artefact
        listed = artefact.features or table.free_features
        mine = poses.artefacts == index
        if artefact.features:
            # Points that were not touched would only add unknowns.
            kept, among = np.unique(features[mine], return_inverse=True)
            artefact = artefact.reduced([listed[feature] for feature in kept])
            if artefact.features != listed:
                listed, features[mine] = artefact.features, among
        artefacts.append(artefact)
        names.append(listed)
    return Campaign(
        artefacts=tuple(artefacts),
        feature_names=tuple(names),
        joint_names=joint_names,
        poses=replace(poses, features=features),
        start_utc=file.start_utc or table.start_utc,
        time_is_order=file.time == "order",
        gravity_m_s2=file.gravity_m_s2,
        encoder_rad=file.noise.encoder_rad,
        contact_mm=file.noise.contact_mm,
        orientation_rad=file.noise.orientation_rad,
        name=path.parent.resolve().name,
        operator=file.operator,
        place=file.place,
        circumstances=file.circumstances,
        digest=campaign_digest(path, file),
        is_stream=is_stream,
        notes=notes,
        tools=file.tools if poses.tools is not None else (),
    )


def _check_lengths(path: Path, file: CampaignFile, poses: Poses) -> None:
    """Refuse poses without a length that should have one, and others that have one."""
    reads = np.array([artefact.reads_lengths for artefact in file.artefacts])
    expected = reads[poses.artefacts]
    are_given = np.zeros(len(poses), dtype=np.bool_)
    if poses.lengths_mm is not None:
        are_given = np.isfinite(poses.lengths_mm)
    problems = [
        Problem(
            f"line {poses.lines[row]}",
            f"length_mm is missing; {file.artefacts[poses.artefacts[row]].id!r} reads "
            "a length at every pose"
            if expected[row]
            else f"length_mm does not belong to "
            f"{file.artefacts[poses.artefacts[row]].id!r}; leave it empty",
        )
        for row in np.flatnonzero(expected != are_given)[:_MOST_PROBLEMS]
    ]
    if problems:
        raise FileError(path, problems)


def _check_orientations(path: Path, file: CampaignFile, poses: Poses) -> None:
    """Refuse orientations at artefacts that have no frame to measure them in."""
    takes = np.array([artefact.has_orientations for artefact in file.artefacts])
    problems = [
        Problem(
            f"line {poses.lines[index]}",
            f"orientation does not belong to {artefact.id!r}, of the kind "
            f"'{artefact.kind}'; only points have a frame to measure it in: leave it "
            "empty",
        )
        for index in np.flatnonzero(poses.oriented & ~takes[poses.artefacts])
        for artefact in [file.artefacts[poses.artefacts[index]]]
    ]
    if problems:
        raise FileError(path, problems[:_MOST_PROBLEMS])


def _places(artefacts: Sequence[Artefact], poses: Poses) -> Floats:
    """Put what was touched into numbers, which are equal for equal points."""
    places = np.zeros((len(poses), 3))
    places[:, 0] = poses.features
    for index, artefact in enumerate(artefacts):
        if isinstance(artefact, Points) and isinstance(artefact.points_mm, dict):
            mine = poses.artefacts == index
            known_mm = np.array(list(artefact.points_mm.values()))
            places[mine] = known_mm[poses.features[mine]]
    return places


def campaign_digest(path: Path, file: CampaignFile) -> str:
    """Hash the file, the poses, and then every list of points."""
    digest = hashlib.sha256(bytes_of(path))
    with (path.parent / file.poses).open("rb") as poses:
        while chunk := poses.read(_CHUNK_BYTES):
            digest.update(chunk)
    for artefact in file.artefacts:
        digest.update(artefact.model_dump_json().encode())
    return digest.hexdigest()


def campaign_of_places(
    joint_names: Sequence[str],
    readings_rad: Floats,
    places_mm: Floats,
    *,
    encoder_rad: float | None = None,
    contact_mm: float | None = None,
) -> Campaign:
    """Make a campaign of places of the ball that another instrument measured.

    Readings (n_poses, n_joints) and places (n_poses, 3) in the instrument's system;
    noise of readings and places where it is known.
    """
    n_poses = len(places_mm)
    names = tuple(f"P{index + 1}" for index in range(n_poses))
    instrument = Points(
        id="instrument",
        kind="points",
        frame="own",
        points_mm=dict(zip(names, map(tuple, places_mm.tolist()), strict=True)),
    )
    return Campaign(
        artefacts=(instrument,),
        feature_names=(names,),
        joint_names=tuple(joint_names),
        poses=Poses(
            lines=np.arange(1, n_poses + 1),
            time_s=np.arange(n_poses, dtype=np.float64),
            artefacts=np.zeros(n_poses, dtype=np.int64),
            features=np.arange(n_poses),
            angles_rad=readings_rad,
        ),
        encoder_rad=encoder_rad,
        contact_mm=contact_mm,
    )
