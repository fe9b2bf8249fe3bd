"""Rows of joint angles with targets, as other programs keep them.

CSV in any dialect, with or without a header (RoboDK); MATLAB's `.mat` (by scipy); ROS 2
bags in MCAP with `sensor_msgs/JointState` and stamped points, poses or transforms (by
mcap-ros2-support).
"""

import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from traverse.arrays import Floats
from traverse.strict_toml.files import open_regular
from traverse.strict_toml.problems import FileError
from traverse.tables.numbers import NumberReader
from traverse.tables.reading import Table, open_table

MOST_ROWS = 1_000_000
# A target so long after or before the nearest joint state has none.
_LONGEST_GAP_S = 0.5
_TARGETS = {
    "geometry_msgs/msg/PointStamped": ("point", None),
    "geometry_msgs/msg/PoseStamped": ("pose.position", "pose.orientation"),
    "geometry_msgs/msg/TransformStamped": (
        "transform.translation",
        "transform.rotation",
    ),
}
# What readers of other people's binary files raise where these are damaged.
_DAMAGED = (
    *(OSError, ValueError, TypeError, LookupError, AttributeError, EOFError),
    *(struct.error, zlib.error),
)
_JOINT_STATE = "sensor_msgs/msg/JointState"


@dataclass(frozen=True, slots=True, eq=False)
class ForeignTable:
    """Columns by name, all of one length.

    Attributes:
        numbers: (n_rows,) each.
        texts: Columns that hold no numbers.
        has_names: Whether the columns have names of their own.
    """

    numbers: Mapping[str, Floats]
    texts: Mapping[str, tuple[str, ...]]
    has_names: bool = True

    @property
    def n_rows(self) -> int:
        columns: list[Any] = [*self.numbers.values(), *self.texts.values()]
        return len(columns[0]) if columns else 0


def read_foreign_table(path: Path, n_joints: int) -> ForeignTable:
    """Read a table by the ending of its name: .mat, .mcap, else CSV.

    Raises:
        FileError: It cannot be read, with what is wrong.
        ModuleNotFoundError: mcap-ros2-support is not installed.
    """
    suffix = path.suffix.lower()
    if suffix == ".mat":
        return _read_mat(path, n_joints)
    if suffix == ".mcap":
        return _read_mcap(path)
    return _read_text(path)


def _read_text(path: Path) -> ForeignTable:
    with open_table(path) as table:
        has_names = not all(map(_is_number, table.header))
        if has_names:
            return _columns(path, table, has_names=True)
    with open_table(path, has_header=False) as table:
        return _columns(path, table, has_names=False)


def _is_number(text: str) -> bool:
    try:
        NumberReader(";").number(text, "deg", 1)
    except ValueError:
        return False
    return True


def _columns(path: Path, table: Table, *, has_names: bool) -> ForeignTable:
    rows = []
    for row in table.rows():
        rows.append(row)
        if len(rows) > MOST_ROWS:
            raise FileError(path, f"has more than {MOST_ROWS} rows; take fewer")
    table.check()
    if not rows:
        raise FileError(path, "holds no rows")
    lines = [line for line, _ in rows]
    numbers: dict[str, Floats] = {}
    texts: dict[str, tuple[str, ...]] = {}
    columns = zip(*(cells for _, cells in rows), strict=True)
    for name, cells in zip(table.header, columns, strict=True):
        values, wrong = table.numbers(lines, name, cells)
        if len(wrong) == sum(map(bool, cells)):
            texts[name] = cells
            continue
        for at, message in wrong.items():
            table.refuse(lines[at], message, name)
        numbers[name] = values
    table.check()
    return ForeignTable(numbers, texts, has_names)


def _read_mat(path: Path, n_joints: int) -> ForeignTable:
    from scipy import io  # noqa: PLC0415 - heavy

    try:
        variables = io.loadmat(path, squeeze_me=False)
    except NotImplementedError as error:
        message = "is a .mat file of version 7.3; save it with -v7"
        raise FileError(path, message) from error
    except (io.matlab.MatReadError, *_DAMAGED) as error:
        raise FileError(path, f"is no .mat file: {error}") from error
    columns: dict[str, Floats] = {}
    for name, value in variables.items():
        if name.startswith("__") or not _is_matrix(value):
            continue
        widths = (1, 3, 4, n_joints, n_joints + 3, n_joints + 7)
        if value.shape[1] not in widths and value.shape[0] in widths:
            value = value.T  # noqa: PLW2901 - a sample is a row here
        for index, label in enumerate(_labels(name, value.shape[1]), 0):
            columns[label] = np.asarray(value[:, index], dtype=np.float64)
    lengths = {len(column) for column in columns.values()}
    if len(lengths) != 1:
        held = ", ".join(f"{n} ({len(c)} rows)" for n, c in list(columns.items())[:12])
        expected = "expected variables of one number of rows"
        raise FileError(path, f"holds {held or 'no matrices'}; {expected}")
    return ForeignTable(columns, {})


def _is_matrix(value: object) -> bool:
    return (
        isinstance(value, np.ndarray)
        and value.ndim == 2
        and value.dtype.kind in "iuf"
        and 0 < value.size <= 100 * MOST_ROWS
    )


def _labels(name: str, width: int) -> Iterator[str]:
    """Name the columns of a variable: q1, q2 ...; p.x, p.y, p.z; r.w, r.x ..."""
    axes = {3: "xyz", 4: "wxyz"}.get(width)
    is_angles = name.lower() in ("q", "qs", "joints", "angles", "theta")
    for index in range(width):
        if width == 1:
            yield name
        elif axes and not is_angles:
            yield f"{name}.{axes[index]}"
        else:
            yield f"{name}{index + 1}"


def _read_mcap(path: Path) -> ForeignTable:
    from mcap.exceptions import McapError  # noqa: PLC0415 - for this kind of file only
    from mcap.reader import make_reader  # noqa: PLC0415 - as above
    from mcap_ros2.decoder import DecoderFactory  # noqa: PLC0415 - extra `ros`

    states: dict[str, list[tuple[float, dict[str, float]]]] = {}
    targets: dict[str, list[tuple[float, list[float]]]] = {}
    factory = DecoderFactory()
    try:
        with open_regular(path) as file:
            for schema, channel, message in make_reader(file).iter_messages():
                kind, topic = schema.name if schema else "", channel.topic
                if kind != _JOINT_STATE and kind not in _TARGETS:
                    continue
                decode = factory.decoder_for(channel.message_encoding, schema)
                if decode is None:
                    encoding = f"encoding {channel.message_encoding!r} of {topic}"
                    raise ValueError(f"{encoding}; expected cdr of ros2msg")
                content = decode(message.data)
                time_s = _time_s(content, message.log_time)
                if kind == _JOINT_STATE:
                    names = zip(content.name, content.position, strict=True)
                    states.setdefault(topic, []).append((time_s, dict(names)))
                else:
                    numbers = list(_numbers_of(kind, content))
                    targets.setdefault(topic, []).append((time_s, numbers))
    except (McapError, *_DAMAGED) as error:
        raise FileError(path, f"is no bag of ROS 2 in MCAP: {error}") from error
    for kind_of_topic, topics in (("JointState", states), ("stamped targets", targets)):
        if len(topics) != 1:
            listed = ", ".join(topics) or "none"
            message_of_all = f"has topics of {kind_of_topic}: {listed}; expected one"
            raise FileError(path, f"{message_of_all}; filter the bag")
    (timed_states,), (timed_targets,) = states.values(), targets.values()
    return _matched(path, timed_states, timed_targets)


def _numbers_of(kind: str, content: Any) -> Iterator[float]:  # noqa: ANN401 - of ROS
    """Yield x, y, z of a target, and w, x, y, z of its orientation."""
    for part, axes in zip(_TARGETS[kind], ("xyz", "wxyz"), strict=True):
        if part is not None:
            yield from (float(getattr(_inner(content, part), axis)) for axis in axes)


def _time_s(content: Any, log_time_ns: int) -> float:  # noqa: ANN401 - of ROS
    stamp = content.header.stamp
    time_s = stamp.sec + 1e-9 * stamp.nanosec
    return time_s if time_s > 0.0 else 1e-9 * log_time_ns


def _inner(content: Any, path: str) -> Any:  # noqa: ANN401 - of ROS
    for step in path.split("."):
        content = getattr(content, step)
    return content


def _matched(
    path: Path,
    states: list[tuple[float, dict[str, float]]],
    targets: list[tuple[float, list[float]]],
) -> ForeignTable:
    """Interpolate the joints' positions to the time of each target."""
    joints = [
        name for name in states[0][1] if all(name in state for _, state in states)
    ]
    if len(states) > MOST_ROWS or len({len(numbers) for _, numbers in targets}) > 1:
        raise FileError(
            path, f"has more than {MOST_ROWS} states, or targets of two kinds"
        )
    states.sort(key=lambda timed: timed[0])
    times_s = np.array([time_s for time_s, _ in states])
    at_s = np.array([time_s for time_s, _ in targets])
    nearest_s = np.min(np.abs(at_s[:, None] - _around(times_s, at_s)), axis=1)
    inside = (at_s >= times_s[0]) & (at_s <= times_s[-1]) & (nearest_s < _LONGEST_GAP_S)
    if not inside.any():
        raise FileError(path, "no target has joint states around its time")
    numbers = {"time_s": at_s[inside] - at_s[inside][0]}
    for name in joints:
        positions = np.array([state[name] for _, state in states])
        numbers[f"{name}_rad"] = np.interp(at_s[inside], times_s, positions)
    columns = np.array([values for _, values in targets])[inside].T
    labels = ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")
    numbers.update(zip(labels, columns, strict=False))
    left_out = int(np.count_nonzero(~inside))
    texts = {f"({left_out} targets without joint states)": ("",) * int(inside.sum())}
    return ForeignTable(numbers, texts if left_out else {})


def _around(times_s: Floats, at_s: Floats) -> Floats:
    """Return the times before and behind, (n, 2)."""
    behind = np.clip(np.searchsorted(times_s, at_s), 1, max(len(times_s) - 1, 1))
    pair = np.stack([behind - 1, np.minimum(behind, len(times_s) - 1)], axis=1)
    around: Floats = times_s[pair]
    return around
