"""Blocks of scans in Parquet, by arm and day: in a folder, or where a URI points to.

A file is there whole or not at all, and counts once the table `scan_block` names it.
"""

import itertools
import time
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import fs

from traverse.fleet.database import StoreAwayError, StoreRefusedError
from traverse.protocol.messages import Scan
from traverse.strict_toml.ownership import reason_of_owner

_AXES = "xyz"


class ScanFiles:
    """Where scans are kept.

    Args:
        root: a folder, which is made, or a URI of `pyarrow.fs` such as
            `s3://bucket/scans`.
        member: becomes part of the files' names.

    Raises:
        StoreRefusedError: there is no such place.
    """

    def __init__(self, root: str, member: str) -> None:
        try:
            if "://" not in root:
                Path(root).mkdir(parents=True, exist_ok=True)
                root = str(Path(root).resolve())
            self._files, self._root = fs.FileSystem.from_uri(root)
        except (OSError, ValueError, pa.ArrowException) as error:
            remedy = reason_of_owner(error) or (
                "expected a folder or a URI such as s3://bucket/scans"
            )
            raise StoreRefusedError(f"{root}: {error}; {remedy}") from error
        self._member = quote(member, safe="")
        self._numbers = itertools.count(time.time_ns())

    def write(self, arm: str, blocks: Iterable[Scan]) -> list[tuple[Scan, str]]:
        """Write blocks of one arm; return each with its file, below the root.

        Raises:
            StoreAwayError: a file cannot be written now.
        """
        by_day: dict[str, list[Scan]] = {}
        for block in blocks:
            began = datetime.fromtimestamp(block.time_ns // 10**9, UTC)
            by_day.setdefault(f"{began:%Y-%m-%d}", []).append(block)
        written = []
        for day, some in by_day.items():
            folder = f"arm={quote(arm, safe='')}/day={day}"
            name = f"{folder}/{self._member}-{next(self._numbers)}.parquet"
            self._write(name, pa.concat_tables(map(_table, some)))
            written += [(block, name) for block in some]
        return written

    def _write(self, name: str, table: pa.Table) -> None:
        path = f"{self._root}/{name}"
        try:
            self._files.create_dir(path.rpartition("/")[0], recursive=True)
            pq.write_table(table, f"{path}.part", filesystem=self._files)
            self._files.move(f"{path}.part", path)
        except (OSError, pa.ArrowException) as error:
            raise StoreAwayError(f"{path}: {error}") from error


def _table(block: Scan) -> pa.Table:
    n = len(block.dtime_ns)
    columns = {
        "session": pa.array([block.session] * n, pa.string()),
        "scan": pa.array([block.scan] * n, pa.string()),
        "number": pa.array(np.arange(block.seq, block.seq + n)),
        "time_ns": pa.array(block.time_ns + block.dtime_ns),
    }
    part = block.part_xyz_mm
    for column, axis in enumerate(_AXES):
        columns[f"{axis}_mm"] = pa.array(block.xyz_mm[:, column])
    for column, axis in enumerate("ijk"):
        columns[axis] = pa.array(block.ijk[:, column])
    for column, axis in enumerate(_AXES):
        columns[f"part_{axis}_mm"] = (
            pa.nulls(n, pa.float64()) if part is None else pa.array(part[:, column])
        )
    covariance_mm2 = block.covariance_mm2
    for column, axes in enumerate(("xx", "xy", "xz", "yy", "yz", "zz")):
        columns[f"covariance_{axes}_mm2"] = (
            pa.nulls(n, pa.float64())
            if covariance_mm2 is None
            else pa.array(covariance_mm2[:, column])
        )
    columns["quality"] = pa.array(block.quality)
    angles = pa.array(block.angles_rad.tolist(), pa.list_(pa.float64()))
    columns["angles_rad"] = angles
    columns["model"] = pa.array([block.model] * n, pa.string())
    columns["probe_radius_mm"] = pa.array(np.full(n, block.probe_radius_mm))
    return pa.table(columns)
