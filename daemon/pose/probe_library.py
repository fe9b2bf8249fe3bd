"""The probe library: probes by name, and the arm with one of them.

`probes.toml` is explained in docs/reference/probe-library.md.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm, Moment, Probe
from traverse.strict_toml.files import json_of
from traverse.strict_toml.problems import Problem, numbers_in, tables_in, vector_in
from traverse.strict_toml.reader import StrictModel, read_strict
from traverse.strict_toml.writing import write_atomically

Vector = tuple[float, float, float]
Covariance = tuple[float, float, float, float, float, float]
IN_USE_SCHEMA = "traverse/probe-in-use/1"


class LibraryProbe(StrictModel):
    """One probe; vectors are in the arm's base posture, as in arm files."""

    name: str = Field(min_length=1, max_length=64)
    radius_mm: float = Field(ge=0.0)
    vector_mm: Vector
    direction: Vector | None = None
    kind: Literal["hard", "switching"]
    date: Moment | None = None
    mass_kg: float | None = Field(default=None, ge=0.0)
    vector_covariance_mm2: Covariance | None = None

    @property
    def covariance_mm2(self) -> Floats | None:
        """Covariance of the vector, (3, 3); None if unknown."""
        if self.vector_covariance_mm2 is None:
            return None
        return full_covariance(self.vector_covariance_mm2)


class ProbeLibrary(StrictModel):
    """The whole file."""

    schema_: Literal["traverse/probes/1"] = Field(alias="schema")
    probes: tuple[LibraryProbe, ...] = Field(min_length=1, max_length=1000)

    def named(self, name: str) -> LibraryProbe | None:
        return next((probe for probe in self.probes if probe.name == name), None)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(probe.name for probe in self.probes)


def read_probes(path: Path) -> ProbeLibrary:
    """Read and check a probe library.

    Raises:
        FileError: lists all mistakes.
    """
    return read_strict(path, ProbeLibrary, _cross_check)


def read_probe_in_use(path: Path) -> str | None:
    """Read the name of the probe that was chosen last; None if none ever was.

    Raises:
        ValueError: the file is damaged; also OSError.
    """
    try:
        values = json_of(path)
    except FileNotFoundError:
        return None
    name = values.get("name") if isinstance(values, dict) else None
    if not isinstance(name, str) or values.get("schema") != IN_USE_SCHEMA:
        raise ValueError(f"it has no name and schema {IN_USE_SCHEMA}")
    return name


def write_probe_in_use(path: Path, name: str | None) -> None:
    """Keep the name of the chosen probe over restarts; None: the arm file's.

    Raises:
        OSError: the disk does not take it.
    """
    if name is None:
        path.unlink(missing_ok=True)
        return
    text = json.dumps({"schema": IN_USE_SCHEMA, "name": name})
    write_atomically(path, text)


def with_probe(arm: Arm, chosen: LibraryProbe) -> Arm:
    probe = Probe(
        radius_mm=chosen.radius_mm,
        kind=chosen.kind,
        vector_mm=chosen.vector_mm,
        direction=chosen.direction,
        mass_kg=chosen.mass_kg,
    )
    return arm.model_copy(update={"probe": probe})


def _cross_check(raw: Mapping[str, Any]) -> Iterator[Problem]:
    """Find duplicate names, invalid directions and covariances."""
    seen: set[str] = set()
    for index, probe in enumerate(tables_in(raw.get("probes"))):
        where, name = f"probes[{index}]", probe.get("name")
        if isinstance(name, str):
            if name in seen:
                text = f"{name!r} occurs twice; names are unique"
                yield Problem(f"{where}.name", text)
            seen.add(name)
        direction = vector_in(probe.get("direction"))
        if direction is not None and not any(direction):
            yield Problem(f"{where}.direction", "has no length; expected one above 0")
        six = numbers_in(probe.get("vector_covariance_mm2"))
        if six is not None and len(six) == 6:
            full = full_covariance(six)
            largest = max(*np.abs(np.diag(full)).tolist(), 1e-12)
            if np.linalg.eigvalsh(full).min() < -1e-9 * largest:
                text = "is no covariance: it has a negative eigenvalue"
                yield Problem(f"{where}.vector_covariance_mm2", text)


def full_covariance(six: Sequence[float]) -> Floats:
    """Return the matrix (3, 3) of xx, xy, xz, yy, yz, zz."""
    xx, xy, xz, yy, yz, zz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
