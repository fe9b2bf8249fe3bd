"""Names of MQTT topics: `traverse/<arm>/<kind>`, and how each kind is sent."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import Final

from traverse.protocol.message_error import MessageError

ROOT: Final = "traverse"
MAX_LEVEL_LENGTH: Final = 64
MAX_RESPONSE_LENGTH: Final = 256
MAX_RESPONSE_LEVELS: Final = 4
"""Below `reply`: the command, and what distinguishes senders."""


_NOT_IN_LEVEL = re.compile(r"[/+#\x00-\x1f\x7f-\x9f]")


@dataclass(frozen=True, slots=True)
class Channel:
    """How messages of one kind are sent."""

    qos: int
    retained: bool


CHANNELS: Final = {
    "status": Channel(qos=1, retained=True),
    "point": Channel(qos=1, retained=False),
    "scan": Channel(qos=0, retained=False),
    "live": Channel(qos=0, retained=False),
    "event": Channel(qos=1, retained=False),
    "health": Channel(qos=0, retained=True),
    "clock": Channel(qos=1, retained=True),
    "cmd": Channel(qos=1, retained=False),
    "reply": Channel(qos=1, retained=False),
}
"""By the level after the arm; scans may be configured to QoS 1."""

NAMED: Final = ("cmd", "reply")
"""Kinds with one more level: the name of the command."""


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic taken apart.

    The kind is a key of `CHANNELS`; others than "cmd" and "reply" have no command.
    """

    arm: str
    kind: str
    command: str | None = None


def _checked(kind: str, level: str) -> str:
    """Return the text if it can be one level of a topic."""
    fits = 1 <= len(level) <= MAX_LEVEL_LENGTH
    if not fits or _NOT_IN_LEVEL.search(level):
        raise MessageError.of(
            f"{kind} name",
            repr(level[:80]),
            f"1 to {MAX_LEVEL_LENGTH} characters without / + # and control characters",
        )
    return level


def _topic(arm: str, kind: str) -> str:
    return f"{ROOT}/{_checked('arm', arm)}/{kind}"


status_topic = partial(_topic, kind="status")
point_topic = partial(_topic, kind="point")  # of retractions, too
scan_topic = partial(_topic, kind="scan")
live_topic = partial(_topic, kind="live")
event_topic = partial(_topic, kind="event")
health_topic = partial(_topic, kind="health")
clock_topic = partial(_topic, kind="clock")


def command_topic(arm: str, name: str) -> str:
    return f"{_topic(arm, 'cmd')}/{_checked('command', name)}"


def reply_topic(arm: str, name: str) -> str:
    """Return the topic of replies to commands without a response topic."""
    return f"{_topic(arm, 'reply')}/{_checked('command', name)}"


def command_filter(arm: str) -> str:
    return f"{_topic(arm, 'cmd')}/+"


def reply_filter(arm: str) -> str:
    return f"{_topic(arm, 'reply')}/+"


def kind_filter(kind: str) -> str:
    if kind not in CHANNELS:
        raise MessageError.of("kind", repr(kind), f"one of {', '.join(CHANNELS)}")
    return f"{ROOT}/+/{kind}" + ("/+" if kind in NAMED else "")


def is_response_topic(topic: str, arm: str, filters: Iterable[str] = ()) -> bool:
    """Return whether an arm may reply to a topic that a sender has named.

    Below `traverse/<arm>/reply/`, or where one of ``filters`` allows it. Otherwise a
    sender could publish through the daemon where it may not itself, such as a command
    to another arm.
    """
    levels = topic.split("/")
    if len(topic) > MAX_RESPONSE_LENGTH or any(map(_NOT_IN_LEVEL.search, levels)):
        return False
    if levels[0] == ROOT:
        below = levels[3:]
        is_reply_topic = levels[1:3] == [arm, "reply"]
        return is_reply_topic and 1 <= len(below) <= MAX_RESPONSE_LEVELS and all(below)
    return any(_matches(levels, pattern.split("/")) for pattern in filters)


def check_response_filter(topic_filter: str) -> None:
    """Check that a filter of response topics is valid, and excludes arms' topics.

    Raises:
        MessageError: it is invalid, or includes topics of arms.
    """
    levels = topic_filter.split("/")
    first, *deeper = levels
    is_filter = (
        1 <= len(topic_filter) <= MAX_RESPONSE_LENGTH
        and not any(
            level not in "+#" and _NOT_IN_LEVEL.search(level) for level in levels
        )
        and "#" not in levels[:-1]
    )
    if not is_filter or not first or first in ("+", "#", ROOT) or first[0] == "$":
        raise MessageError.of(
            "filter",
            repr(topic_filter[:80]),
            f"an MQTT topic filter whose first level is a name, and neither {ROOT} nor "
            "one that begins with $",
        )
    if not deeper:
        raise MessageError.of(
            "filter", repr(topic_filter[:80]), "at least two levels, as in answers/#"
        )


def parse_topic(topic: str) -> Topic:
    """Take a topic apart.

    Raises:
        MessageError: it is not a topic of Traverse.
    """
    root, *levels = topic.split("/")
    if root == ROOT and len(levels) == 2 and levels[1] not in NAMED:
        arm, kind, command = levels[0], levels[1], None
    elif root == ROOT and len(levels) == 3 and levels[1] in NAMED:
        arm, kind, command = levels[0], levels[1], _checked("command", levels[2])
    else:
        arm, kind, command = "", "", None
    if kind not in CHANNELS:
        raise MessageError.of(
            "topic",
            repr(topic[:200]),
            f"{ROOT}/<arm>/ with one of {', '.join(CHANNELS)}; "
            f"a command's name after {' and '.join(NAMED)}, nothing after the others",
        )
    return Topic(_checked("arm", arm), kind, command)


def _matches(levels: list[str], pattern: list[str]) -> bool:
    """Whether a topic matches a filter, both taken apart at the slashes."""
    if pattern[-1] == "#":
        pattern = pattern[:-1]
        levels = levels[: len(pattern)]
    return len(levels) == len(pattern) and all(
        expected in ("+", level)
        for expected, level in zip(pattern, levels, strict=True)
    )
