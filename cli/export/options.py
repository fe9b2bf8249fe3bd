"""Options of `traverse export`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from traverse.cli.common.qif_check import QifSchemas


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportOptions:
    r"""The options, in the order of `--help`.

    Attributes:
        to: csv, dxf, jsonl, npz, parquet, ply, qif, ros2, text, xyz or campaign; or a
            format of another package (traverse extensions).
        kind: Part of a recording.
        coordinates: Of the ball, of the touched surface, or in the part.
        session: Only points of this session.
        filters: TOML file with [[filters]], as [[scan.filters]] of a daemon.
        template: With --to text: such as '{seq};{x_mm:.3f}\n'.
        decimal: Decimal sign of numbers in csv, text and xyz.
        retracted: Retracted points and retractions, too.
    """

    to: str = "csv"
    kind: Literal["points", "scans"] = "points"
    coordinates: Literal["centre", "surface", "part"] = "centre"
    session: str | None = None
    filters: Path | None = None
    template: str = ""
    decimal: Literal[".", ","] = "."
    retracted: bool = False
    schemas: QifSchemas = None
