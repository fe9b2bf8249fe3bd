"""Points of an outbox as a table or as messages in JSON."""

import csv
from collections.abc import Callable, Iterable
from typing import TextIO

from daemon.outbox_values import Held
from protocol.encoding import decode, encode
from protocol.message_error import MessageError
from protocol.messages import Point

FORMATS = ("csv", "jsonl")
AXES = ("x", "y", "z")
TENSOR = ("xx", "xy", "xz", "yy", "yz", "zz")
COLUMNS = (
    *("session", "seq", "id", "retracts", "time_ns", "trigger"),
    *(f"{axis}_mm" for axis in AXES),
    *("i", "j", "k"),
    *(f"surface_{axis}_mm" for axis in AXES),
    "compensation",
    *(f"part_{axis}_mm" for axis in AXES),
    *(f"covariance_{axes}_mm2" for axes in TENSOR),
    *("temperature_c", "probe_radius_mm", "samples", "spread_mm"),
    *("artefact", "feature", "ok", "flags", "model", "angles_rad", "counts"),
)


def write_points(
    messages: Iterable[Held], file: TextIO, as_format: str
) -> tuple[int, list[str]]:
    """Write messages; gives how many were written, and what was wrong with others."""
    write = _row_writer(file) if as_format == "csv" else _message_writer(file)
    n, unreadable = 0, []
    for message in messages:
        try:
            point = decode(Point, message.payload, message.encoding)
        except MessageError as error:
            unreadable.append(f"{message.id}: cannot be read and is left out: {error}")
            continue
        write(point)
        n += 1
    return n, unreadable


def _message_writer(file: TextIO) -> Callable[[Point], object]:
    return lambda point: file.write(encode(point, "json").decode() + "\n")


def _row_writer(file: TextIO) -> Callable[[Point], object]:
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(COLUMNS)
    return lambda point: writer.writerow(_row(point))


def _row(point: Point) -> list[object]:
    """A point in the order of `COLUMNS`; what is not known is empty."""
    return [
        point.session,
        point.seq,
        point.id,
        point.retracts,
        point.time_ns,
        point.trigger,
        *point.xyz_mm,
        *point.ijk,
        *(point.surface_mm or [None] * 3),
        point.compensation,
        *(point.part_xyz_mm or [None] * 3),
        *(point.covariance_mm2 or [None] * 6),
        point.temperature_c,
        point.probe_radius_mm,
        point.samples,
        point.spread_mm,
        point.label.artefact,
        point.label.feature,
        int(point.quality.ok),
        " ".join(point.quality.flags),
        point.model,
        " ".join(map(repr, point.angles_rad)),
        " ".join(map(str, point.counts)),
    ]
