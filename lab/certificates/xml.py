"""XML of certificates: written in one form, read without trust, held to a schema."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lxml import etree

from traverse.strict_toml.files import bytes_of
from traverse.strict_toml.problems import FileError

OWN_SCHEMAS = Path(__file__).parent / "schemas"
SCHEMA = "dcc.xsd"
_DECLARATION = b"<?xml version='1.0' encoding='UTF-8'?>\n"


def _parser(*, compact: bool = False) -> "etree.XMLParser[etree._Element]":
    """Make a parser that fetches nothing, expands nothing and bounds depth."""
    return etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        remove_blank_text=compact,
    )


def read_xml(content: bytes, source: str) -> etree._Element:
    """Read a document.

    Raises:
        FileError: It is not XML, or has a document type, which certificates have not.
    """
    try:
        root = etree.fromstring(content, _parser())
    except etree.XMLSyntaxError as error:
        raise FileError(source, f"is not XML: {error.msg}") from error
    if root.getroottree().docinfo.doctype:
        raise FileError(source, "has a DOCTYPE; certificates have none")
    return root


def indented(text: str, source: str) -> etree._Element:
    """Read what a template made, and indent it.

    Raises:
        FileError: A value has a character that XML does not have.
    """
    try:
        root = etree.fromstring(text.encode(), _parser(compact=True))
    except etree.XMLSyntaxError as error:
        message = f"states a character that XML does not have: {error.msg}"
        raise FileError(source, message) from error
    etree.indent(root, space=" ")
    return root


def xml_bytes(root: etree._Element) -> bytes:
    """Write a document in the one form that certificates have."""
    return _DECLARATION + etree.tostring(root, encoding="UTF-8") + b"\n"


class _FromFolder(etree.Resolver):
    """Finds schemas in one folder that are not where they are imported from."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._folder = folder

    def resolve(
        self,
        system_url: str | None,
        public_id: str | None,
        context: Any,  # noqa: ANN401 - of lxml
    ) -> Any:  # noqa: ANN401 - of lxml
        named = Path(system_url or "")
        if named.is_file():
            return None  # one file must have one name, or it would be read twice
        name = named.name
        return self.resolve_string(bytes_of(self._folder / name), context)


def schema_problems(
    root: etree._Element, schemas: Path | None, name: str = SCHEMA
) -> Iterator[str]:
    """Hold a document to the schema of a folder; None: the part that comes with us.

    Raises:
        FileError: The folder has no schema, or one that cannot be used.
    """
    path = (schemas or OWN_SCHEMAS) / name
    parser = _parser()
    parser.resolvers.add(_FromFolder(path.parent))
    try:
        schema = etree.XMLSchema(
            etree.fromstring(bytes_of(path), parser, base_url=str(path.resolve()))
        )
    except (etree.LxmlError, OSError) as error:
        message = f"is no schema that can be used: {error}; see the guide to --schemas"
        raise FileError(path, message) from error
    if not schema.validate(root):
        for entry in schema.error_log:
            yield f"line {entry.line}: {entry.message}"
