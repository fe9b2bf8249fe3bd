"""A configuration that is being made or changed, and its files."""

import os
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from traverse.daemon.config.schema import Configuration, read_configuration
from traverse.daemon.inputs import StartupError, read_inputs
from traverse.strict_toml.files import text_of
from traverse.strict_toml.problems import FileError, tables_in, toml_table, toml_text
from traverse.strict_toml.rewriting import rewritten_text
from traverse.strict_toml.writing import write_atomically

KEPT = 20  # replaced files of one name


class Draft:
    """The text of a configuration file, changed until it is written.

    Args:
        path: Of the file, which may be missing.

    Attributes:
        text: As `write` would write it.

    Raises:
        FileError: The file is no TOML.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.text = ""
        if path.exists():
            self.replace_text(toml_text(path))

    @property
    def values(self) -> dict[str, Any]:
        return toml_table(self.text, str(self.path))

    @property
    def devices(self) -> list[Mapping[str, Any]]:
        """The `[[device]]` tables."""
        return tables_in(self.values.get("device"))

    @property
    def arm_file(self) -> str:
        """The name of the arm file; empty before it is known."""
        return str(self.values.get("arm", {}).get("file", ""))

    def replace_text(self, text: str) -> None:
        """Take another text.

        Raises:
            FileError: It is no TOML.
        """
        toml_table(text, str(self.path))
        self.text = text

    def set_devices(self, tables: Sequence[Mapping[str, Any]]) -> None:
        """Replace the `[[device]]` tables; comments and layout of the rest stay."""
        self._set({**self.values, "device": list(tables) or None})

    def set_table(self, name: str, changes: Mapping[str, object]) -> None:
        """Set keys of a table; None removes a key; an empty table is removed."""
        table = {**self.values.get(name, {}), **changes}
        is_empty = all(value is None for value in table.values())
        self._set({**self.values, name: None if is_empty else table})

    def _set(self, values: Mapping[str, Any]) -> None:
        before = f"{self.text.rstrip()}\n\n" if self.text.strip() else ""
        self.text = f"{rewritten_text(values, before).rstrip()}\n"

    def problems(self) -> list[str]:
        """Return all mistakes of configuration, arm file and probe library."""
        trial = self.path.with_name(f".{self.path.name}.{os.getpid()}.trial")
        try:
            write_atomically(trial, self.text)
            read_inputs(trial, embedded="broker" not in self.values)
        except StartupError as error:
            mistakes = [str(file) for file in error.files] or [str(error)]
            return [text.replace(str(trial), str(self.path)) for text in mistakes]
        finally:
            trial.unlink(missing_ok=True)
        return []

    def configuration(self) -> Configuration:
        """Read the written file.

        Raises:
            FileError: It is missing, or has mistakes.
        """
        return read_configuration(self.path)

    def write(self) -> Path | None:
        """Write the file; return where the one before is kept.

        Raises:
            OSError: The folder cannot be written.
        """
        previous = None
        if self.path.exists() and self.text != text_of(self.path):
            previous = keep_previous(self.path)
        write_atomically(self.path, self.text)
        return previous

    def arm_files(self) -> list[str]:
        return [
            path.name
            for path in sorted(self.path.parent.glob("*.toml"))
            if _is_arm_file(path)
        ]


def keep_previous(path: Path) -> Path:
    """Copy a file that will be replaced; only the newest copies are kept."""
    now = datetime.now(UTC)
    copy = path.with_name(f"{path.name}.{now:%Y%m%dT%H%M%S.%f}.old")
    write_atomically(copy, text_of(path))
    copies = sorted(path.parent.glob(f"{path.name}.*.old"))
    for oldest in copies[:-KEPT]:
        oldest.unlink(missing_ok=True)
    return copy


def _is_arm_file(path: Path) -> bool:
    try:
        schema = toml_table(toml_text(path), str(path)).get("schema")
    except FileError:
        return False
    return str(schema).startswith("traverse/arm/")
