"""Make an arm file of the values that a MicroScribe reports.

Its table has six of Craig's rows, without offsets: theta is the reading. Rows behind
the last joint with an encoder do not turn and carry the stylus. The base posture is
the home position, where the arm must be while it is switched on.
"""

import os
import re
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from traverse.arrays import Floats
from traverse.drivers.io.serial_port import SerialPort
from traverse.drivers.microscribe.line import MicroscribeLine
from traverse.drivers.microscribe.session import (
    BAUD_RATES,
    MicroscribeIdentification,
    read_identification,
    sign_on_at_any_rate,
)
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.importers.arm_values import (
    JointParts,
    assemble_arm,
)
from traverse.kinematics.importers.dh import DHTable, geometry_from_dh, probe_transforms
from traverse.kinematics.model.geometry import Geometry, unit_vectors
from traverse.kinematics.model.quaternion import rotate, turn
from traverse.protocol.microscribe.session import DH_FORMAT, Kinematics, kinematics_of
from traverse.strict_toml.problems import FileError, Problem

N_ROWS = 6
_BETA_JOINT = 3


@dataclass(frozen=True, slots=True)
class MicroscribeDescription:
    """The arm's report.

    Attributes:
        name: of the arm, for people.
        source: where that was read, for messages.
        maxes: greatest count of each encoder; 0 for one that is not there.
        home: counts at the home position, of as many encoders at least.
    """

    name: str
    source: str
    kinematics: Kinematics
    maxes: tuple[int, ...]
    home: tuple[int, ...]


def query_microscribe(
    port: str, baud_rate: int | None, name: str | None
) -> tuple[MicroscribeIdentification, MicroscribeDescription]:
    """The properties that an arm reports, with its geometry.

    Without a baud rate all are tried; without a name it has the reported one.

    Raises:
        DeviceError: no MicroScribe answers.
        FileError: its geometry is not one that can be read.
    """
    rates = BAUD_RATES if baud_rate is None else (baud_rate,)
    with _session(port, rates) as (line, arm):
        table_format, comment = line.text("format"), line.text("comment")
        if table_format != DH_FORMAT:
            problem = (
                f"the arm keeps its geometry as {table_format!r}, expected "
                f"{DH_FORMAT!r}; make the arm file with `traverse arm from-dh`"
            )
            raise FileError(port, [Problem("format", problem)])
        try:
            kinematics = kinematics_of(line.kinematics(), comment)
        except ValueError as error:
            problem = f"{error}; make the arm file with `traverse arm from-dh`"
            raise FileError(port, [Problem("geometry", problem)]) from error
        home = (*line.home(), *[0] * len(arm.maxes.encoders))
    maxes = arm.maxes.encoders
    return arm, MicroscribeDescription(
        name or topic_name(arm.name), port, kinematics, maxes, home
    )


def topic_name(text: str) -> str:
    """Convert a text to an arm name, which is a part of topics."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-") or "microscribe"


@contextmanager
def _session(
    port: str, rates: Sequence[int]
) -> Iterator[tuple[MicroscribeLine, MicroscribeIdentification]]:
    wake_read, wake_write = os.pipe2(os.O_NONBLOCK)

    def open_line(rate: int) -> MicroscribeLine:
        serial_port = SerialPort(port, rate, wake_read)
        return MicroscribeLine(serial_port, rate, time.monotonic_ns, lambda: False)

    try:
        line, box = sign_on_at_any_rate(open_line, rates)
        with line:
            try:
                yield line, read_identification(line, box)
            finally:
                line.end()
    finally:
        os.close(wake_read)
        os.close(wake_write)


def arm_from_microscribe(
    description: MicroscribeDescription, device: str, radius_mm: float
) -> Arm:
    """Make an arm of a MicroScribe's values; the radius is 0 for a pointed stylus.

    Raises:
        FileError: it cannot be such an arm.
    """
    n = _joint_count(description)
    counts = [greatest + 1 for greatest in description.maxes[:n]]
    home_rad = np.array(
        [
            2.0 * np.pi * (home % count) / count
            for home, count in zip(description.home[:n], counts, strict=True)
        ]
    )
    joints = [
        JointParts(f"J{k + 1}", counts[k], 1, f"{device}/{k}", absolute=False)
        for k in range(n)
    ]
    geometry = geometry_of(description.kinematics, home_rad)
    return assemble_arm(
        description.name, geometry, joints, description.source, radius_mm=radius_mm
    )


def geometry_of(kinematics: Kinematics, base_posture_rad: Floats) -> Geometry:
    """Write the arm's table in a base posture, (n_joints,) with an encoder."""
    n = len(base_posture_rad)
    bare = _table(kinematics, 0, n)
    geometry = geometry_from_dh(
        replace(bare, tool=_stylus(_table(kinematics, n, N_ROWS))), base_posture_rad
    )
    if kinematics.beta_rad:
        # The y axis of the frame that joint 3 turns in, before it has turned.
        until = _table(kinematics, 0, _BETA_JOINT)
        posture_rad = base_posture_rad[:_BETA_JOINT].copy()
        posture_rad[-1] = 0.0
        frame = probe_transforms(until, posture_rad[np.newaxis])[0]
        geometry = _tilted(geometry, frame[:3, 1], kinematics.beta_rad)
    return geometry


def _joint_count(description: MicroscribeDescription) -> int:
    is_present = [bool(greatest) for greatest in description.maxes]
    n = sum(is_present)
    problems = []
    if not all(is_present[:n]):
        problem = (
            f"greatest counts are {list(description.maxes)}; one is 0 between others, "
            "so the joints are ambiguous"
        )
        problems.append(Problem("encoders", problem))
    elif not _BETA_JOINT <= n <= N_ROWS:
        problem = f"there are {n}, expected {_BETA_JOINT} to {N_ROWS}, the rows of the "
        problem += "arm's own table; make the arm file with `traverse arm from-dh`"
        problems.append(Problem("encoders", problem))
    if problems:
        raise FileError(description.source, problems)
    return n


def _table(kinematics: Kinematics, start: int, end: int) -> DHTable:
    rows = slice(start, end)
    return DHTable(
        convention="modified",
        a_mm=np.array(kinematics.a_mm[rows]),
        d_mm=np.array(kinematics.d_mm[rows]),
        alpha_rad=np.array(kinematics.alpha_rad[rows]),
        theta_rad=np.zeros(end - start),
        base=np.eye(4),
        tool=np.eye(4),
    )


def _stylus(rows: DHTable) -> Floats:
    """Return the transform behind the last joint, (4, 4)."""
    if not rows.n_joints:
        return np.eye(4)
    stylus: Floats = probe_transforms(rows, np.zeros((1, rows.n_joints)))[0]
    return stylus


def _tilted(geometry: Geometry, axis: Floats, beta_rad: float) -> Geometry:
    """Turn all from joint 3 on about an axis through its origin."""
    first = _BETA_JOINT - 1
    tilt = turn(axis, np.array(beta_rad))

    def outer(vectors: Floats) -> Floats:
        turned = np.array(vectors)
        turned[first:] = rotate(tilt[:, np.newaxis], turned[first:].T).T
        return turned

    return replace(
        geometry,
        axes=unit_vectors(outer(geometry.axes)),
        links_mm=outer(geometry.links_mm),
        probe_vector_mm=rotate(tilt, geometry.probe_vector_mm),
        probe_direction=unit_vectors(rotate(tilt, geometry.probe_direction)),
    )
