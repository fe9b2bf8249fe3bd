"""Arms from tables and descriptions: files and options in, an arm's values out.

Nothing is changed silently: names that an arm file cannot have, origins that are slid
along their hinges and values that can hardly be meant are in the remarks.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import typer

from traverse.arrays import Floats
from traverse.cli.arm.options import ArmOptions
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.importers.arm_values import (
    JointParts,
    assemble_arm,
)
from traverse.kinematics.importers.dh import Convention, DHTable, geometry_from_dh
from traverse.kinematics.importers.dh_file import (
    DHFile,
    Placement,
    Units,
    read_dh_file,
)
from traverse.kinematics.importers.joint_names import names_for_arm
from traverse.kinematics.importers.unit_doubts import angle_doubt, reach_doubt
from traverse.kinematics.importers.urdf import Body, Mimic, arm_from_chain, transform
from traverse.kinematics.importers.urdf_chain import Holds, chain_of
from traverse.kinematics.importers.urdf_file import read_urdf
from traverse.kinematics.model.geometry import Geometry
from traverse.kinematics.model.origins import length_mm, near_origins, slides_mm
from traverse.strict_toml.problems import FileError, Problem
from traverse.tables.numbers import NumberReader, unit_of


@dataclass(frozen=True, slots=True)
class MadeArm:
    """An arm that was made of another description.

    Attributes:
        renamed: New names of joints by their names in the description.
        remarks: Changes, and implausible values.
    """

    arm: Arm
    renamed: Mapping[str, str]
    remarks: tuple[str, ...]


def arm_from_dh_file(
    path: Path,
    units: Units,
    options: ArmOptions,
    *,
    convention: str | None,
    base_xyz_mm: str | None,
    base_rpy_rad: str | None,
) -> MadeArm:
    """Make an arm of a Denavit-Hartenberg table; options go before the file's words.

    Raises:
        FileError: With everything that is wrong with the table.
        typer.BadParameter: An option is wrong; names it.
    """
    file = read_dh_file(path, units)
    rows = file.rows
    table = DHTable(
        convention=_convention(path, file, convention),
        a_mm=np.array([row.a_mm for row in rows]),
        d_mm=np.array([row.d_mm for row in rows]),
        alpha_rad=np.array([row.alpha_rad for row in rows]),
        theta_rad=np.array([row.theta_rad for row in rows]),
        base=_placed("base", file.base, base_xyz_mm, base_rpy_rad),
        tool=_placed("tool", file.tool, options.tool_xyz_mm, options.tool_rpy_rad),
    )
    posture_rad = posture_of(
        options.base_posture_rad,
        options.base_posture_deg,
        [row.base_rad for row in rows],
    )
    return _made(
        path,
        options,
        options.name or file.name or path.stem,
        geometry_from_dh(table, np.array(posture_rad)),
        [row.name or f"J{k}" for k, row in enumerate(rows, start=1)],
        wires=[(row.counts_per_turn, row.sign, row.source) for row in rows],
        doubts=file.doubts(),
    )


def arm_from_urdf_file(
    path: Path, root: str | None, tip: str | None, holds: Holds, options: ArmOptions
) -> MadeArm:
    """Make an arm of a robot description.

    Raises:
        FileError: With everything that is wrong with the description.
        typer.BadParameter: An option is wrong; names it.
    """
    robot = read_urdf(path)
    chain = chain_of(robot, root, tip, holds)
    count = sum(joint.axis is not None for joint in chain)
    posture_rad = posture_of(
        options.base_posture_rad, options.base_posture_deg, [0.0] * count
    )
    tool = _placed("tool", None, options.tool_xyz_mm, options.tool_rpy_rad)
    arm = arm_from_chain(chain, tool, np.array(posture_rad))
    return _made(
        path,
        options,
        options.name or robot.name or path.stem,
        arm.geometry,
        arm.names,
        wires=[(None, None, None)] * count,
        bodies=arm.bodies,
        mimics=arm.mimics,
        doubts=robot.doubts,
    )


def _made(
    path: Path,
    options: ArmOptions,
    name: str,
    geometry: Geometry,
    joint_names: Sequence[str],
    *,
    wires: Sequence[tuple[int | None, int | None, str | None]],
    bodies: Sequence[Body | None] | None = None,
    mimics: Sequence[Mimic | None] | None = None,
    doubts: Iterable[str] = (),
) -> MadeArm:
    try:
        names, renamed = names_for_arm(joint_names, _renames(options.rename or ()))
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--rename") from error
    remarks = [f"joint {old!r} is called {new}" for old, new in renamed.items()]
    near = near_origins(geometry)
    if near is not geometry:
        remarks.append(
            "origins slid along hinges that are nearly parallel, which moves nothing: "
            f"links of {length_mm(geometry):.0f} mm together are "
            f"{length_mm(near):.0f} mm now"
        )
        moved_mm = slides_mm(geometry, near)
        bodies = bodies and [
            body and Body(body.mass_kg, body.centre_mm - moved_mm[k])
            for k, body in enumerate(bodies)
        ]
    remarks += doubts
    if options.base_posture_rad is not None:
        for angle_rad in geometry.zeros_rad.tolist():
            remarks += angle_doubt("a reading of --base-posture-rad", angle_rad)
    remarks += reach_doubt(near)
    followed = dict(zip(joint_names, names, strict=True))
    mimics = mimics and [
        mimic and mimic._replace(joint=followed[mimic.joint]) for mimic in mimics
    ]
    joints = _joints(path, options, names, wires, bodies=bodies, mimics=mimics)
    arm = assemble_arm(
        name,
        near,
        joints,
        str(path),
        radius_mm=options.radius_mm,
        probe_kind=options.probe_kind,
    )
    return MadeArm(arm, renamed, tuple(remarks))


def _renames(texts: Iterable[str]) -> dict[str, str]:
    """Parse `--rename OLD=NEW`; a new name has no '='.

    Raises:
        ValueError: One has no '='.
    """
    renames: dict[str, str] = {}
    for text in texts:
        old, equals, new = text.rpartition("=")
        if not equals:
            raise ValueError(f"'{text}' is not of the form OLD=NEW")
        renames[old] = new
    return renames


def holds_of(mm: Iterable[str], rad: Iterable[str]) -> Holds:
    """Parse `--hold-mm` and `--hold-rad JOINT=VALUE`.

    Raises:
        typer.BadParameter: One has not this form.
    """
    values: dict[str, dict[str, float]] = {}
    for option, assignments in (("--hold-mm", mm), ("--hold-rad", rad)):
        values[option] = {}
        for text in assignments:
            name, equals, number = text.rpartition("=")
            if not equals:
                problem = f"'{text}' is not of the form JOINT=VALUE"
                raise typer.BadParameter(problem, param_hint=option)
            values[option][name] = numbers_of(option, number, 1)[0]
    return Holds(values["--hold-mm"], values["--hold-rad"])


def _convention(path: Path, file: DHFile, requested: str | None) -> Convention:
    in_file = file.convention
    if in_file is None and requested is None:
        problem = "is not given; use --convention classic or --convention modified"
        raise FileError(path, [Problem("convention", problem)])
    if in_file is not None and requested is not None and in_file != requested:
        problem = (
            f"is {in_file} in the file, but --convention says {requested}; drop one"
        )
        raise FileError(path, [Problem("convention", problem)])
    return "modified" if (in_file or requested) == "modified" else "classic"


def _placed(
    option_stem: str,
    placement_in_file: Placement | None,
    xyz_mm: str | None,
    rpy_rad: str | None,
) -> Floats:
    placement_in_file = placement_in_file or Placement()
    return transform(
        numbers_of(f"--{option_stem}-xyz-mm", xyz_mm, 3)
        if xyz_mm
        else placement_in_file.xyz_mm,
        numbers_of(f"--{option_stem}-rpy-rad", rpy_rad, 3)
        if rpy_rad
        else placement_in_file.rpy_rad,
    )


def _joints(
    path: Path,
    options: ArmOptions,
    names: Sequence[str],
    wires: Sequence[tuple[int | None, int | None, str | None]],
    *,
    bodies: Sequence[Body | None] | None = None,
    mimics: Sequence[Mimic | None] | None = None,
) -> list[JointParts]:
    """Joints of counts per turn, sign and source of each, where options say no more."""
    n = len(names)
    counts: Sequence[int | None] = [wire[0] for wire in wires]
    signs: Sequence[int | None] = [wire[1] for wire in wires]
    sources = [wire[2] for wire in wires]
    if options.counts_per_turn:
        counts = integers_of("--counts-per-turn", options.counts_per_turn, n)
    if options.signs:
        signs = integers_of("--signs", options.signs, n)
    idle = [
        names[k]
        for k in range(n)
        if counts[k] is None and (signs[k], sources[k]) != (None, None)
    ]
    if idle:
        problem = (
            f"{', '.join(idle)}: a sign or source, but no encoder; give counts per turn"
        )
        raise FileError(path, problem)
    return [
        JointParts(
            name=names[k],
            counts_per_turn=counts[k],
            sign=sign if (sign := signs[k]) is not None else 1,
            source=sources[k] or f"{options.device}/{k}",
            body=bodies[k] if bodies else None,
            mimic=mimics[k] if mimics else None,
            absolute=options.absolute,
        )
        for k in range(n)
    ]


# In mm or rad: nothing of an arm is larger, and sums stay finite.
_LARGEST = 1e9


def numbers_of(option: str, text: str, count: int) -> tuple[float, ...]:
    """Read numbers with commas between them.

    Raises:
        typer.BadParameter: They are not `count` numbers, finite.
    """
    unit = unit_of(option.replace("-", "_"))
    reader = NumberReader(",")
    try:
        numbers = tuple(reader.number(word, unit, 1) for word in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(abs(n) < _LARGEST for n in numbers):
        expected = f"{count} number{'s' * (count > 1)} below 1e9, commas between"
        raise typer.BadParameter(f"'{text}' is not {expected}", param_hint=option)
    return numbers


def integers_of(option: str, text: str, count: int) -> tuple[int, ...]:
    """Read one integer a joint; a single one holds for all."""
    try:
        numbers = tuple(int(word) for word in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) not in (1, count):
        expected = f"one integer, or {count} with commas between"
        raise typer.BadParameter(f"'{text}' is not {expected}", param_hint=option)
    return numbers * count if len(numbers) == 1 else numbers


def posture_of(
    rad: str | None, deg: str | None, default_rad: Sequence[float]
) -> tuple[float, ...]:
    if rad is not None and deg is not None:
        raise typer.BadParameter(
            "is given in degrees too; give one of them", param_hint="--base-posture-rad"
        )
    if rad is not None:
        return numbers_of("--base-posture-rad", rad, len(default_rad))
    if deg is not None:
        degrees = numbers_of("--base-posture-deg", deg, len(default_rad))
        return tuple(math.radians(degree) for degree in degrees)
    return tuple(default_rad)
