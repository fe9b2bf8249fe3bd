"""Numpy arrays as fields of a message: checked, read-only, described."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

_NUMBERS: dict[str, set[type]] = {
    "f": {int, float},
    "i": {int},
    "u": {int},
    "b": {bool},
}


@dataclass(frozen=True, slots=True)
class ArrayField:
    """The dtype and shape that a field's array must have.

    In MessagePack it is the extension type of `traverse.protocol.arrays`, in JSON
    nested lists. Elements are finite. An array without elements has all its free
    dimensions 0, which nested lists cannot show.

    Attributes:
        dtype: name of the dtype, for example "float64".
        shape: one entry per dimension, a number or the name of a free one.
    """

    dtype: str
    shape: tuple[int | str, ...]

    def __get_pydantic_core_schema__(
        self, _source: object, _handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Hooks of pydantic: how to validate and how to write."""
        return core_schema.no_info_plain_validator_function(
            self.checked,
            serialization=core_schema.plain_serializer_function_ser_schema(
                np.ndarray.tolist, when_used="json"
            ),
        )

    def __get_pydantic_json_schema__(
        self, _core: CoreSchema, _handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """The JSON form: nested lists."""
        kind = np.dtype(self.dtype).kind
        schema: JsonSchemaValue = {
            "type": {"f": "number", "b": "boolean"}.get(kind, "integer")
        }
        for size in reversed(self.shape):
            schema = {"type": "array", "items": schema}
            if isinstance(size, int):
                schema |= {"minItems": size, "maxItems": size}
        return schema | {"x-dtype": self.dtype, "x-shape": list(self.shape)}

    def checked(self, value: object) -> NDArray[np.generic]:
        """Check an array, or build one from nested lists.

        Raises:
            ValueError: another dtype or shape, or an element that is not finite.
        """
        if isinstance(value, np.ndarray):
            array: NDArray[np.generic] = value
        else:
            array = self._from_nested(value)
        if array.dtype != np.dtype(self.dtype):
            raise ValueError(f"an array of {self.dtype}, not {array.dtype}")
        if not self._fits(array.shape):
            raise ValueError(
                f"an array of shape {self._shape_text()}, not {array.shape}"
            )
        if array.dtype.kind == "f" and not np.isfinite(array).all():
            raise ValueError("finite numbers only")
        if array.size == 0:
            sizes = [size if isinstance(size, int) else 0 for size in self.shape]
            array = np.zeros(sizes, self.dtype)
        elif array.flags.writeable or not array.flags.c_contiguous:
            array = array.copy(order="C")
        array.flags.writeable = False
        return array

    def _fits(self, shape: tuple[int, ...]) -> bool:
        return len(shape) == len(self.shape) and all(
            expected in (observed, 0) or isinstance(expected, str)
            for expected, observed in zip(self.shape, shape, strict=True)
        )

    def _shape_text(self) -> str:
        return "(" + ", ".join(map(str, self.shape)) + ")"

    def _from_nested(self, value: object) -> NDArray[np.generic]:
        """Nested lists of numbers; numpy itself would take strings and ragged ones."""
        level: list[Any] = [value]
        sizes: list[int] = []
        for _ in self.shape:
            if not all(isinstance(row, list | tuple) for row in level):
                raise ValueError(f"an array of shape {self._shape_text()}")
            lengths = {len(row) for row in level}
            if len(lengths) > 1:
                raise ValueError(f"rows of equal length, not {sorted(lengths)[:5]}")
            sizes.append(lengths.pop() if lengths else 0)
            level = [element for row in level for element in row]
        dtype = np.dtype(self.dtype)
        if not {type(element) for element in level} <= _NUMBERS[dtype.kind]:
            raise ValueError(f"elements that are numbers of {self.dtype}")
        if not level:
            sizes = [size if isinstance(size, int) else 0 for size in self.shape]
        try:
            return np.array(level, dtype).reshape(sizes)
        except OverflowError as error:
            raise ValueError(f"elements in the range of {self.dtype}") from error
