"""Points as a table of pandas, for notebooks."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from traverse.client.exports.text import COLUMNS, row_of
from traverse.protocol.messages import Point

if TYPE_CHECKING:
    from pandas import DataFrame


def to_pandas(points: Iterable[Point]) -> "DataFrame":
    """Return points as a DataFrame: a row each, with the columns of exported CSV.

    `time_utc` is a timestamp; `ok` is True where a point is not in doubt.

    Raises:
        ModuleNotFoundError: pandas is not installed.
    """
    from pandas import DataFrame, to_datetime  # noqa: PLC0415 - few programs need it

    frame = DataFrame(map(row_of, points), columns=list(COLUMNS))
    frame["time_utc"] = to_datetime(frame["time_ns"], unit="ns", utc=True)
    frame["ok"] = frame["ok"].astype(bool)
    return frame
