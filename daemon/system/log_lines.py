"""Entries of the log as lines: for people, or one JSON object each."""

import json
import logging
from collections.abc import Mapping
from datetime import UTC, datetime


class PlainLines(logging.Formatter):
    """Time (local), level, text."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)-7s %(message)s", "%H:%M:%S")


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
        return json.dumps(entry, ensure_ascii=False, default=str)


def fields_of(record: logging.LogRecord) -> Mapping[str, str | int]:
    """The fields of an entry: `extra={"fields": {...}}`, without empty ones."""
    fields: Mapping[str, str | int] = getattr(record, "fields", {})
    return {name: value for name, value in fields.items() if value != ""}
