"""SHA256SUMS: the digests of a folder's files, as `sha256sum --check` reads them."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from traverse.lab.report.provenance import digest_of_files
from traverse.strict_toml.files import bytes_of
from traverse.strict_toml.writing import write_atomically

SUMS = "SHA256SUMS"


def sums_of(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """Compute the digests of files by their names below a folder, in hexadecimal.

    Raises:
        OSError: One cannot be read.
    """
    return {name: digest_of_files([folder / name]) for name in sorted(names)}


def write_sums(folder: Path, sums: Mapping[str, str]) -> None:
    """Write the digests into the folder."""
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
