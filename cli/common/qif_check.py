"""Validation of QIF against the standard's schema, where its files are given."""

from pathlib import Path
from typing import Annotated

import typer

from traverse.strict_toml.problems import FileError, Problem

SCHEMA = "QIFDocument.xsd"
QifSchemas = Annotated[
    Path | None,
    typer.Option(
        envvar="TRAVERSE_SCHEMAS",
        help="Of QIF: folder with QIFDocument.xsd and all that it includes.",
    ),
]


def check_schema(content: bytes, file: Path, schemas: Path) -> None:
    """Check a document against the schema (extra `certificate`).

    Raises:
        FileError: It does not keep to the schema, or that cannot be used.
    """
    from traverse.lab.certificates.xml import read_xml, schema_problems  # of an extra

    complaints = schema_problems(read_xml(content, str(file)), schemas, SCHEMA)
    problems = [Problem("", f"schema: {message}") for message in complaints]
    if problems:
        raise FileError(file, problems)


def schema_words(schemas: Path | None) -> str:
    if schemas is None:
        return "not checked against the schema (no schemas folder given)"
    return f"keeps to {schemas / SCHEMA}"
