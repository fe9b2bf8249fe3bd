"""Reply: the answer to a command."""

from typing import Any, Literal, Self

from pydantic import (
    ConfigDict,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from traverse.protocol.messages.event import EventCode
from traverse.protocol.messages.fields import Message, Name, Text, Value, schema_field
from traverse.protocol.messages.plain import PlainMap


class ReplyError(Value):
    """Why a command was not carried out."""

    code: EventCode
    """For programs, in dotted words: "command.bad_args"."""
    text: Text
    """For people: what, where, observed value, what was expected."""
    remedy: Text
    """What to do about it."""


class Reply(Message):
    """The answer to a command: `result` if it was done, else `error`."""

    model_config = ConfigDict(
        json_schema_extra={
            "oneOf": [
                {"properties": {"ok": {"const": True}}, "required": ["result"]},
                {"properties": {"ok": {"const": False}}, "required": ["error"]},
            ]
        }
    )

    schema_: Literal["traverse/reply/1"] = schema_field("traverse/reply/1")
    request: Name
    """As in the command."""
    ok: bool
    """True: done."""
    result: PlainMap | None = None
    """Result of the command; present only if ok is true."""
    error: ReplyError | None = None
    """Reason; present only if ok is false."""

    @model_validator(mode="after")
    def _agrees_with_itself(self) -> Self:
        if self.ok != (self.result is not None) or self.ok == (self.error is not None):
            raise ValueError("a result where ok is true, an error where it is false")
        return self

    @model_serializer(mode="wrap")
    def _leave_out_the_other(
        self, write: SerializerFunctionWrapHandler
    ) -> dict[str, Any]:
        written: dict[str, Any] = write(self)
        written.pop("error" if self.ok else "result")
        return written
