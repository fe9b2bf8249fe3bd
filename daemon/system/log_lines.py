"""Entries of the log as lines: for people, or one JSON object each."""

import json
import logging
from collections.abc import Mapping
from datetime import UTC, datetime

from traverse.protocol.printable import printable


class PlainLines(logging.Formatter):
    """Time (local), level, text; further lines are indented, so that none looks new."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)-7s %(message)s", "%H:%M:%S")

    def format(self, record: logging.LogRecord) -> str:
        """The entry, mostly as one line."""
        first, *others = map(printable, super().format(record).split("\n"))
        return "\n".join(
            (first, *(line if line[:1] == " " else f" {line}" for line in others))
        )


class JsonLines(logging.Formatter):
    """One object a line: `time` (UTC), `level`, `logger`, `message`, fields, fault."""

    def format(self, record: logging.LogRecord) -> str:
        """The entry as one line."""
        moment = datetime.fromtimestamp(record.created, UTC)
        entry: dict[str, object] = {
            "time": moment.isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **fields_of(record),
        }
        if record.exc_info:
            entry["fault"] = self.formatException(record.exc_info)
        text = json.dumps(entry, ensure_ascii=False, default=str)
        if text.isprintable():
            return text
        return "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in text)


def fields_of(record: logging.LogRecord) -> Mapping[str, str | int]:
    """The fields of an entry: `extra={"fields": {...}}`, without empty ones."""
    fields: Mapping[str, str | int] = getattr(record, "fields", {})
    return {name: value for name, value in fields.items() if value != ""}
