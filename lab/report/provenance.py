"""Origin of a report: author, time, and versions."""

import getpass
import hashlib
import os
import platform
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from traverse.strict_toml.files import bytes_of, open_regular
from traverse.strict_toml.writing import write_atomically

# Names who computes, where that is not the user of the computer.
OPERATOR_VARIABLE = "TRAVERSE_OPERATOR"


@dataclass(frozen=True, slots=True)
class ReportSource:
    """Measurement that a report is about: folder or file, and its SHA-256, if any."""

    name: str
    sha256: str


@dataclass(frozen=True, slots=True)
class ReportProvenance:
    """The provenance of a report.

    Attributes:
        date_utc: Of the computation, ISO 8601 to the second, with Z.
        computed_by: A name, or user@host.
        versions: Of Traverse, Python and numpy, by name.
    """

    date_utc: str
    computed_by: str
    versions: dict[str, str]
    campaign: ReportSource

    @property
    def values(self) -> dict[str, Any]:
        return asdict(self)


def report_provenance(
    campaign: ReportSource,
    computed_by: str | None = None,
    when: datetime | None = None,
) -> ReportProvenance:
    """Make the provenance of a report.

    Computed by that of `TRAVERSE_OPERATOR` where nobody is named, else by user@host.
    """
    return ReportProvenance(
        date_utc=utc_text(when or datetime.now(UTC)),
        computed_by=computed_by
        or os.environ.get(OPERATOR_VARIABLE)
        or f"{_user()}@{platform.node()}",
        versions={
            "Traverse": version("traverse-cmm"),
            "Python": platform.python_version(),
            "numpy": np.__version__,
        },
        campaign=campaign,
    )


def utc_text(moment: datetime) -> str:
    """Write a time as ISO 8601 in UTC, to the second, with Z."""
    return f"{moment.astimezone(UTC):%Y-%m-%dT%H:%M:%SZ}"


def digest_of_files(paths: Iterable[Path]) -> str:
    """Compute the SHA-256 over files, one after the other.

    Raises:
        OSError: One cannot be read.
    """
    digest = hashlib.sha256()
    for path in paths:
        with open_regular(path) as file:
            while piece := file.read(2**20):
                digest.update(piece)
    return digest.hexdigest()


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # a container whose user has no name
        return f"uid {os.getuid()}"


SUMS = "SHA256SUMS"


def sums_of(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """Compute the digests of files by their names below a folder, in hexadecimal.

    Raises:
        OSError: One cannot be read.
    """
    return {name: digest_of_files([folder / name]) for name in sorted(names)}


def write_sums(folder: Path, sums: Mapping[str, str]) -> None:
    write_atomically(folder / SUMS, _text(sums))


def read_sums(folder: Path) -> dict[str, str] | None:
    """Read the digests; None where there are none.

    Raises:
        ValueError: The file is not as it was written.
    """
    path = folder / SUMS
    if not path.is_file():
        return None
    content = bytes_of(path)
    lines = content.decode("ascii", "replace").splitlines()
    sums = {line[66:]: line[:64] for line in lines}
    if _text(sums).encode() != content or any(len(line) < 67 for line in lines):
        raise ValueError(f"{SUMS} was altered: it is not as it was written")
    return sums


def sums_problems(folder: Path, required: Iterable[str] = ()) -> Iterator[str]:
    """Name the files that are missing or altered.

    Without the digests nothing is named, unless some files are required to be in them.
    """
    try:
        sums = read_sums(folder) or {}
    except ValueError as error:
        yield str(error)
        return
    for name in required:
        if name not in sums:
            yield f"{SUMS} is missing, or was altered: {name} is not in it"
    for name, digest in sums.items():
        path = folder / name
        if Path(name).is_absolute() or ".." in Path(name).parts:
            yield f"{SUMS} was altered: {name} lies elsewhere"
        elif not path.is_file():
            yield f"{name} is missing"
        elif digest_of_files([path]) != digest:
            yield f"{name} was altered: its digest is not that of {SUMS}"


def _text(sums: Mapping[str, str]) -> str:
    return "".join(f"{sums[name]}  {name}\n" for name in sorted(sums))
