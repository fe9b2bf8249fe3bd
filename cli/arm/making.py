"""Arms from tables and descriptions: files and options in, an arm's values out."""

import math
from collections.abc import Sequence
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
from traverse.kinematics.importers.urdf import Body, Mimic, arm_from_chain, transform
from traverse.kinematics.importers.urdf_file import chain_of, read_urdf
from traverse.strict_toml.problems import FileError, Problem


def arm_from_dh_file(
    path: Path,
    units: Units,
    options: ArmOptions,
    *,
    convention: str | None,
    base_xyz_mm: str | None,
    base_rpy_rad: str | None,
) -> Arm:
    """Make an arm of a Denavit-Hartenberg table; options go before the file's words.

    Raises:
        FileError: With everything that is wrong with the table.
        typer.BadParameter: With what is wrong with an option.
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
    joints = _joints(
        path,
        options,
        [row.name or f"J{k}" for k, row in enumerate(rows, start=1)],
        [(row.counts_per_turn, row.sign, row.source) for row in rows],
    )
    return assemble_arm(
        options.name or file.name or path.stem,
        geometry_from_dh(table, np.array(posture_rad)),
        joints,
        str(path),
        radius_mm=options.radius_mm,
        probe_kind=options.probe_kind,
    )


def arm_from_urdf_file(
    path: Path, root: str | None, tip: str | None, options: ArmOptions
) -> Arm:
    """Make an arm of a robot description.

    Raises:
        FileError: With everything that is wrong with the description.
        typer.BadParameter: With what is wrong with an option.
    """
    robot = read_urdf(path)
    chain = chain_of(robot, root, tip)
    count = sum(joint.axis is not None for joint in chain)
    posture_rad = posture_of(
        options.base_posture_rad, options.base_posture_deg, [0.0] * count
    )
    tool = _placed("tool", None, options.tool_xyz_mm, options.tool_rpy_rad)
    arm = arm_from_chain(chain, tool, np.array(posture_rad))
    wires = [(None, None, None)] * count
    joints = _joints(
        path, options, arm.names, wires, bodies=arm.bodies, mimics=arm.mimics
    )
    return assemble_arm(
        options.name or robot.name or path.stem,
        arm.geometry,
        joints,
        str(path),
        radius_mm=options.radius_mm,
        probe_kind=options.probe_kind,
    )


def _convention(path: Path, file: DHFile, wished: str | None) -> Convention:
    said = file.convention
    if said is None and wished is None:
        what = "is not given; use --convention classic or --convention modified"
        raise FileError(path, [Problem("convention", what)])
    if said is not None and wished is not None and said != wished:
        what = f"is {said} in the file, but --convention says {wished}; drop one"
        raise FileError(path, [Problem("convention", what)])
    return "modified" if (said or wished) == "modified" else "classic"


def _placed(
    which: str, said: Placement | None, xyz_mm: str | None, rpy_rad: str | None
) -> Floats:
    said = said or Placement()
    return transform(
        numbers_of(f"--{which}-xyz-mm", xyz_mm, 3) if xyz_mm else said.xyz_mm,
        numbers_of(f"--{which}-rpy-rad", rpy_rad, 3) if rpy_rad else said.rpy_rad,
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
        what = (
            f"{', '.join(idle)}: a sign or source, but no encoder; give counts per turn"
        )
        raise FileError(path, what)
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
    try:
        numbers = tuple(float(word) for word in text.split(","))
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
    """Take the base posture from whichever option is given."""
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
