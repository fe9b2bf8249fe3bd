"""What the columns of another program's table mean, guessed and said.

Joints by their names or numbers, targets by x, y, z, orientations by w, x, y, z; units
by their names, else by what can be meant, else by the arm: its ball has to move as the
targets do, whatever the frame. What stays open is refused, with the option that says
it.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.helmert.transformation import closed_helmert
from traverse.kinematics.importers.joint_names import names_for_arm
from traverse.kinematics.model.forward import probe_pose
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.campaign.foreign_table import ForeignTable

AngleUnit = Literal["rad", "deg"]
LengthUnit = Literal["mm", "m", "inch"]
ANGLES: Mapping[AngleUnit, float] = {"rad": 1.0, "deg": np.pi / 180.0}
LENGTHS: Mapping[LengthUnit, float] = {"mm": 1.0, "m": 1000.0, "inch": 25.4}

_UNIT = re.compile(
    r"(?:[\s_]+|[\s_]*[\[(])"
    r"(degrees|degree|deg|\u00b0|radians|rad|mm|meters|m|inch|in|s|ms|us|ns|c)[\])]?$"
)
_UNIT_NAMES = {
    **dict.fromkeys(("degrees", "degree", "deg", "\u00b0"), "deg"),
    **dict.fromkeys(("radians", "rad"), "rad"),
    **dict.fromkeys(("meters", "m"), "m"),
    **dict.fromkeys(("inch", "in"), "inch"),
    "mm": "mm",
    **{unit: unit for unit in ("s", "ms", "us", "ns")},
    "c": "c",
}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_NUMBERED = re.compile(r"(joint|j|q|theta|th|axis|a|angle|joints|angles)(\d{1,2})")
_NO_PLACES = re.compile(r"(r|rot|rpy|w|omega|v|vel|f|force|torque|acc|std|sigma)_?$")
_TRUSTED = re.compile(r"target|track|meas|laser|leica|camera")
_TIMES = ("time", "t", "timestamp", "times", "stamp")
_TEMPERATURES = ("temperature", "temp", "temperaturec")
_LABELS = ("feature", "point", "name", "label", "target", "id")
_FULL_TURN_RAD = 2.0 * np.pi * (1.0 + 1e-3)


class UnclearError(ValueError):
    """A table is ambiguous; names the option that decides."""


@dataclass(frozen=True, slots=True)
class ColumnOptions:
    """Columns and units that the user names; None where they are guessed."""

    joints: Sequence[str] | None = None
    position: Sequence[str] | None = None
    angles: AngleUnit | None = None
    lengths: LengthUnit | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Understood:
    """A table as it was understood.

    Attributes:
        joints: Column of each joint, in the order of the arm.
        position: Columns of x, y, z.
        orientation: Columns of w, x, y, z; empty where there are none.
        time: Column, with its unit s.
        temperature: Column, Celsius.
        label: Column that names the targets.
        left_out: Columns that are not used.
        angles_rad: (n, n_joints).
        places_mm: Of the targets, (n, 3).
        reasons: Why the units are what they are.
        fits: Root mean square distance between ball and targets after the best rigid
            motion, by the units, [mm]; of the units that were tried.
    """

    joints: tuple[str, ...]
    position: tuple[str, ...]
    orientation: tuple[str, ...]
    time: str | None
    temperature: str | None
    label: str | None
    left_out: tuple[str, ...]
    angle_unit: AngleUnit
    length_unit: LengthUnit
    angles_rad: Floats
    places_mm: Floats
    reasons: tuple[str, ...]
    fits: Mapping[tuple[AngleUnit, LengthUnit], float]

    @property
    def rms_mm(self) -> float:
        """Distance between ball and targets after the best rigid motion."""
        return self.fits[self.angle_unit, self.length_unit]


def understood(
    table: ForeignTable,
    geometry: Geometry,
    joint_names: Sequence[str],
    options: ColumnOptions,
) -> Understood:
    """Find out what the columns of a table are.

    Raises:
        UnclearError: Something stays open.
    """
    names = list(table.numbers)
    joints = _given(options.joints, names, "--joints") or _joints(table, joint_names)
    if len(joints) != len(joint_names):
        named, expected = len(joints), len(joint_names)
        raise UnclearError(f"--joints names {named} columns; the arm has {expected}")
    other_names = [name for name in names if name not in joints]
    orientation = _quadruple(other_names)
    position = _given(options.position, names, "--position") or _position(
        table,
        [name for name in other_names if name not in orientation],
        len(joints),
    )
    if len(position) != 3:
        raise UnclearError("--position names three columns: x,y,z")
    raw_angles = np.column_stack([table.numbers[name] for name in joints])
    raw_places = np.column_stack([table.numbers[name] for name in position])
    for kind, numbers in (("joint", raw_angles), ("target", raw_places)):
        if not np.isfinite(numbers).all():
            row = int(np.flatnonzero(~np.isfinite(numbers).all(axis=1))[0]) + 1
            raise UnclearError(
                f"a {kind} of row {row} is empty; fill it, or drop the row"
            )
    stated_angle, stated_length = _stated(joints, ANGLES), _stated(position, LENGTHS)
    angle_unit: Any = options.angles or stated_angle
    length_unit: Any = options.lengths or stated_length
    reasons = []
    if angle_unit is None and np.abs(raw_angles).max() > _FULL_TURN_RAD:
        angle_unit = "deg"
        largest = np.abs(raw_angles).max()
        reasons.append(
            f"angles are degrees: {largest:g} is more than a turn in radians"
        )
    fits = {
        units: _rigid_rms_mm(geometry, raw_angles, raw_places, *units)
        for units in product(
            (angle_unit,) if angle_unit else ANGLES,
            (length_unit,) if length_unit else LENGTHS,
        )
    }
    best = min(fits, key=lambda units: fits[units] / _spread_mm(raw_places, units[1]))
    for unit, kind, guess in (
        (angle_unit, "angles", best[0]),
        (length_unit, "lengths", best[1]),
    ):
        if unit is None:
            reasons.append(f"{kind} are {guess}: so the arm fits the targets best")
    used = {*joints, *position, *orientation}
    time = _one_of(names, used, _TIMES)
    temperature = _one_of(names, used, _TEMPERATURES)
    label = _one_of(table.texts, set(), _LABELS)
    everything = [*table.numbers, *table.texts]
    used |= {name for name in (time, temperature, label) if name is not None}
    return Understood(
        joints=tuple(joints),
        position=tuple(position),
        orientation=tuple(orientation),
        time=time,
        temperature=temperature,
        label=label,
        left_out=tuple(name for name in everything if name not in used),
        angle_unit=best[0],
        length_unit=best[1],
        angles_rad=ANGLES[best[0]] * raw_angles,
        places_mm=LENGTHS[best[1]] * raw_places,
        reasons=tuple(reasons),
        fits=fits,
    )


def _parts(name: str) -> tuple[str, str | None]:
    """Split a column's name into what it is, plainly, and its unit."""
    lower = name.strip().lower()
    match = _UNIT.search(lower)
    unit = _UNIT_NAMES[match[1]] if match and match.start() > 0 else None
    bare = lower[: match.start()] if match and unit else lower
    return re.sub(r"[\s_.:/-]+", "", bare), unit


def unit_of_column(name: str) -> str | None:
    return _parts(name)[1]


def _given(
    columns: Sequence[str] | None, names: Sequence[str], option: str
) -> list[str] | None:
    if columns is None:
        return None
    for column in columns:
        if column not in names:
            known = ", ".join(names)
            raise UnclearError(f"{option}: no column {column!r}; there are: {known}")
    return list(columns)


def _joints(table: ForeignTable, joint_names: Sequence[str]) -> list[str]:
    n_joints, names = len(joint_names), list(table.numbers)
    if not table.has_names:
        return names[:n_joints]
    plain = {_parts(name)[0]: name for name in names}
    mapped, _ = names_for_arm(names, {})
    plain |= {_parts(new)[0]: old for new, old in zip(mapped, names, strict=True)}
    by_name = [plain.get(_parts(joint)[0]) for joint in joint_names]
    if all(by_name):
        return [name for name in by_name if name is not None]
    families: dict[str, dict[int, str]] = {}
    for name in names:
        match = _NUMBERED.fullmatch(_parts(name)[0])
        if match:
            families.setdefault(match[1], {})[int(match[2])] = name
    all_joints = [
        [numbered[at] for at in sorted(numbered)]
        for numbered in families.values()
        if sorted(numbered) in ([*range(n_joints)], [*range(1, n_joints + 1)])
    ]
    if len(all_joints) == 1:
        return all_joints[0]
    number = "several sets of" if all_joints else "no"
    raise UnclearError(
        f"{number} columns for the joints {', '.join(joint_names)}; say which by "
        f"--joints, of: {', '.join(names)}"
    )


def _sets(names: Sequence[str], axes: str) -> Iterator[tuple[str, list[str]]]:
    """Yield what is before the axis, and the columns that differ by it alone."""
    plain = {_parts(name)[0]: name for name in names}
    for bare in plain:
        for index, letter in enumerate(bare):
            if letter == axes[0]:
                alike = [f"{bare[:index]}{axis}{bare[index + 1 :]}" for axis in axes]
                if all(key in plain for key in alike):
                    yield bare[:index], [plain[key] for key in alike]


def _quadruple(names: Sequence[str]) -> list[str]:
    quadruples = [columns for _, columns in _sets(names, "wxyz")]
    return quadruples[0] if len(quadruples) == 1 else []


def _position(table: ForeignTable, names: list[str], n_joints: int) -> list[str]:
    if not table.has_names:
        return list(table.numbers)[n_joints : n_joints + 3]
    sets = [pair for pair in _sets(names, "xyz") if not _NO_PLACES.search(pair[0])]
    trusted = [pair for pair in sets if _TRUSTED.search("".join(pair[1]).lower())]
    candidates = trusted if len(trusted) == 1 else sets
    if len(candidates) == 1:
        return candidates[0][1]
    number = "several sets of" if candidates else "no"
    raise UnclearError(
        f"{number} columns for x, y, z of the targets; say which by --position, of: "
        f"{', '.join(names)}"
    )


def _stated(columns: Sequence[str], units: Mapping[Any, float]) -> str | None:
    stated = {_parts(name)[1] for name in columns}
    (unit,) = stated if len(stated) == 1 else (None,)
    if len(stated) > 1:
        raise UnclearError(f"columns {', '.join(columns)} have different units")
    return unit if unit in units else None


def _one_of(
    names: Sequence[str] | Mapping[str, object], used: set[str], known: Sequence[str]
) -> str | None:
    return next((n for n in names if n not in used and _parts(n)[0] in known), None)


def _spread_mm(places: Floats, unit: LengthUnit) -> float:
    off = places - places.mean(axis=0)
    return max(LENGTHS[unit] * float(np.sqrt(np.mean(np.sum(off**2, axis=1)))), 1e-9)


def _rigid_rms_mm(
    geometry: Geometry,
    angles: Floats,
    places: Floats,
    angle_unit: AngleUnit,
    length_unit: LengthUnit,
) -> float:
    """Return how far the ball is from the targets after the best rigid motion."""
    ball_mm, _ = probe_pose(geometry, ANGLES[angle_unit] * angles)
    place_mm = LENGTHS[length_unit] * places
    motion = closed_helmert(ball_mm, place_mm, np.ones(len(ball_mm)), with_scale=False)
    off_mm = motion.places_mm(ball_mm) - place_mm
    return float(np.sqrt(np.mean(np.sum(off_mm**2, axis=1))))
