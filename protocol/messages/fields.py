"""Types of the fields of all messages.

Rules that hold everywhere: a value is frozen; unknown keys are refused; nothing is
converted (a string is no number, 1.0 is no integer; an integer is a good float);
NaN and infinity are refused; an integer fits into 53 bits, so that every JSON reader
keeps it. The exception are times in nanoseconds, which need 61 bits: integers in
MessagePack, strings of digits in JSON.
"""

import ast
import inspect
from itertools import pairwise
from typing import Annotated, TypeVar

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    PlainSerializer,
    ValidationInfo,
    WithJsonSchema,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

MAX_INTEGER = 2**53 - 1
MAX_TIME_NS = 2**63 - 1
MAX_TIME_DIGITS = 19
MAX_JOINTS = 32
_Schema = TypeVar("_Schema", bound=str)
SCHEMA_MEANING = "Name and version of this message."


class Value(BaseModel):
    """A frozen, strict part of a message."""

    model_config = ConfigDict(
        frozen=True,
        strict=True,
        extra="forbid",
        allow_inf_nan=False,
        serialize_by_alias=True,
    )

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Describe each key by the docstring of its field.

        pydantic's `use_attribute_docstrings` reads the sources at each start.
        """
        reference = handler(core_schema)
        keys = handler.resolve_ref_schema(reference)["properties"]
        for kind in reversed(cls.__mro__[: cls.__mro__.index(Value)]):
            body = ast.parse(inspect.getsource(kind)).body[0].body  # type: ignore[attr-defined]  # a class
            for field, following in pairwise(body):
                match field, following:
                    case (
                        ast.AnnAssign(target=ast.Name(id=name)),
                        ast.Expr(value=ast.Constant(value=str(text))),
                    ) if name in cls.model_fields:
                        key = cls.model_fields[name].alias or name
                        keys[key]["description"] = inspect.cleandoc(text)
        return reference

    def __eq__(self, other: object) -> bool:
        """Equal in type and in every field; arrays by dtype, shape and elements."""
        if type(self) is not type(other):
            return False
        mine, theirs = vars(self), vars(other)
        return all(_same(mine[name], theirs[name]) for name in mine)

    def __hash__(self) -> int:
        """Agrees with equality; a TypeError where a field is a map or an array."""
        return hash(tuple(vars(self).values()))


def schema_field(schema: _Schema) -> _Schema:
    field: _Schema = Field(schema, alias="schema", description=SCHEMA_MEANING)
    return field


class Message(Value):
    """The content of one payload; every one begins with its `schema`."""

    schema_: str = Field(alias="schema", description=SCHEMA_MEANING)


def _same(left: object, right: object) -> bool:
    if isinstance(left, np.ndarray) and isinstance(right, np.ndarray):
        return left.dtype == right.dtype and np.array_equal(left, right)
    return type(left) is type(right) and bool(left == right)


def _digits_to_time(value: object, info: ValidationInfo) -> object:
    """In JSON a time is a string of digits, and nothing else."""
    if info.mode != "json":
        return value
    if not (
        isinstance(value, str)
        and value.isascii()
        and value.isdigit()
        and len(value) <= MAX_TIME_DIGITS
    ):
        raise ValueError("a time in JSON is a string of at most 19 digits")
    return int(value)


TimeNs = Annotated[
    int,
    Field(ge=0, le=MAX_TIME_NS),
    BeforeValidator(_digits_to_time),
    PlainSerializer(str, return_type=str, when_used="json"),
    WithJsonSchema({"type": "string", "format": "time-ns", "pattern": "^[0-9]{1,19}$"}),
]
Integer = Annotated[int, Field(ge=-MAX_INTEGER, le=MAX_INTEGER)]
Count = Annotated[int, Field(ge=0, le=MAX_INTEGER)]
NotNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
Vector = tuple[float, float, float]
Angles = Annotated[tuple[float, ...], Field(max_length=MAX_JOINTS)]
Counts = Annotated[tuple[Integer, ...], Field(max_length=MAX_JOINTS)]

Name = Annotated[str, Field(min_length=1, max_length=64)]
Text = Annotated[str, Field(max_length=2000)]
ArmName = Annotated[str, Field(pattern=r"^[^/+#\x00]{1,64}$")]
Word = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,63}$")]
Digest = Annotated[str, Field(min_length=1, max_length=128)]
