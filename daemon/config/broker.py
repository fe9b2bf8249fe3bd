"""The table [broker] of the configuration: where results go, and how to get in."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from traverse.kinematics.arm_file.arm import Problem, StrictModel
from traverse.protocol import topics
from traverse.protocol.message_error import MessageError

TLS_PORT = 8883

FileName = Annotated[str, Field(min_length=1, max_length=4096)]


class BrokerSection(StrictModel):
    """Where results go.

    There is no key that switches the check of the broker's certificate off.
    """

    host: str = Field(default="localhost", min_length=1, max_length=253)
    port: int = Field(default=1883, ge=1, le=65535)
    username: str | None = Field(default=None, min_length=1, max_length=256)
    password_file: FileName | None = None
    tls: bool = False
    ca_file: FileName | None = None
    certificate_file: FileName | None = None
    key_file: FileName | None = None
    response_topics: Annotated[tuple[str, ...], Field(max_length=16)] = ()
    keepalive_s: int = Field(default=15, ge=1, le=600)
    encoding: Literal["msgpack", "json"] = "msgpack"

    @model_validator(mode="before")
    @classmethod
    def _take_the_usual_port(cls, raw: object) -> object:
        """With TLS and without a port it is that of MQTT over TLS."""
        if isinstance(raw, Mapping) and raw.get("tls") is True and "port" not in raw:
            return {**raw, "port": TLS_PORT}
        return raw


def broker_table_problems(raw: object) -> Iterator[Problem]:
    """What does not go together in a table [broker]."""
    if not isinstance(raw, Mapping):
        return
    if raw.get("tls") is not True:
        for key in ("ca_file", "certificate_file", "key_file"):
            if key in raw:
                text = "is given without tls = true; the line would not be encrypted"
                yield Problem(f"broker.{key}", text)
    for key, other in (
        ("certificate_file", "key_file"),
        ("key_file", "certificate_file"),
    ):
        if key in raw and other not in raw:
            text = f"is missing; {key} is given, and the two belong together"
            yield Problem(f"broker.{other}", text)
    if "password_file" in raw and "username" not in raw:
        text = "is missing; password_file is given, and a password needs a name"
        yield Problem(".".join(("broker", "username")), text)
    yield from _filter_problems(raw.get("response_topics"))


def _filter_problems(filters: Any) -> Iterator[Problem]:  # noqa: ANN401 - of a file
    """Filters that are none, or that would let answers into topics of arms."""
    if not isinstance(filters, list):
        return
    for index, one in enumerate(filters):
        if not isinstance(one, str):
            continue
        try:
            topics.check_response_filter(one)
        except MessageError as error:
            yield Problem(f"broker.response_topics[{index}]", str(error))
