"""Why lines of a table of poses cannot be used: slow, careful, in words."""

import math
from collections.abc import Iterator, Mapping, Sequence

from traverse.lab.campaign.pose_columns import PoseColumns
from traverse.strict_toml.problems import Problem, shown, unknown_name_message


def row_problems(
    rows: Sequence[Sequence[str]],
    first_line: int,
    columns: PoseColumns,
    features: Mapping[str, tuple[str, ...]],
) -> Iterator[Problem]:
    """Yield what is wrong with some rows.

    Args:
        rows: Cells.
        first_line: Line of the first row in the file, from 1.
        columns: Where the columns are.
        features: The features that each artefact has, by its id; none: any.
    """
    for line, cells in enumerate(rows, first_line):
        where = f"line {line}"
        if len(cells) != len(columns.names):
            found = "is empty" if not cells else f"has {len(cells)} columns"
            yield Problem(
                where, f"{found}; expected {len(columns.names)}, as in the header"
            )
            continue
        for message in _cell_messages(cells, columns, features):
            yield Problem(where, message)


def _cell_messages(
    cells: Sequence[str],
    columns: PoseColumns,
    features: Mapping[str, tuple[str, ...]],
) -> Iterator[str]:
    artefact, feature = cells[columns.artefact], cells[columns.feature]
    if artefact not in features:
        yield unknown_name_message("artefact", artefact, features)
    elif features[artefact] and feature not in features[artefact]:
        yield (
            unknown_name_message("feature", feature, features[artefact])
            + f" ({artefact})"
        )
    for index in columns.numeric:
        if _number(cells[index]) is None:
            found = shown(cells[index])
            yield f"{columns.names[index]} is {found}, not a finite number"
    for name, index in columns.optional.items():
        if not cells[index]:
            continue
        number = _number(cells[index])
        if number is None:
            found = shown(cells[index])
            yield f"{name} is {found}, not a finite number; or leave it empty"
        elif name.endswith("_approach") and number not in (-1.0, 0.0, 1.0):
            yield f"{name} is {shown(cells[index])}; expected -1, 0 or 1"
    yield from _direction_messages(cells, columns)


def _direction_messages(cells: Sequence[str], columns: PoseColumns) -> Iterator[str]:
    if "direction_x" not in columns.optional:
        return
    texts = [cells[columns.optional[f"direction_{axis}"]] for axis in "xyz"]
    if not any(texts):
        return
    if not all(texts):
        yield f"direction is {shown(texts)}; give all three components or none"
        return
    numbers = [_number(text) for text in texts]
    known = [number for number in numbers if number is not None]
    if len(known) == 3 and not abs(math.hypot(*known) - 1.0) < 1e-3:
        yield f"direction has the length {math.hypot(*known):.6g}; expected 1"


def _number(text: str) -> float | None:
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) and "_" not in text else None
