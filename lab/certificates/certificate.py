"""Digital calibration certificates: made from evidence, signed, and checked.

A certificate follows from the evidence and from the laboratory's file beside it: a
check makes it anew and compares every byte but the signature.
"""

from collections.abc import Sequence
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

from cryptography.x509 import Certificate
from lxml import etree

from traverse.lab.acceptance.certificate.check import DATA, LABORATORY
from traverse.lab.acceptance.laboratory import Laboratory
from traverse.lab.certificates.evidence import (
    evidence_files,
    evidence_problems,
    evidence_text,
    laboratory_on_page,
)
from traverse.lab.certificates.signature import (
    SIGNATURE,
    Checked,
    SigningKey,
    checked_signature,
    signed,
)
from traverse.lab.certificates.trace import DCC
from traverse.lab.certificates.xml import (
    indented,
    read_xml,
    schema_problems,
    xml_bytes,
)
from traverse.lab.report.provenance import sums_of, sums_problems, write_sums
from traverse.strict_toml.files import bytes_of
from traverse.strict_toml.problems import FileError
from traverse.strict_toml.reader import read_strict
from traverse.strict_toml.writing import replacing, write_atomically

_ISSUED = "{https://ptb.de/dcc}issueDate"


def issue_date(laboratory: Laboratory) -> date:
    """Return the day of issue, by default today.

    Raises:
        FileError: It is in the future, wherever on earth.
    """
    today = datetime.now(UTC).date()
    issued = laboratory.issued or today
    if issued > today + timedelta(days=1):
        raise FileError("laboratory.toml", f"issued is {issued}, which is to come")
    return issued


def certify(
    folder: Path, laboratory: Path, key: SigningKey | None, schemas: Path | None = None
) -> Path:
    """Write the certificate of a folder of results into it, and return its path.

    Raises:
        FileError: The figures do not follow from the data, a file or the laboratory's
            statements cannot be used, or the certificate does not keep to the schema.
    """
    problems = list(sums_problems(folder)) or list(evidence_problems(folder))
    if problems:
        raise FileError(folder, problems)
    stated = read_strict(laboratory, Laboratory)
    on_page = laboratory_on_page(folder)
    if on_page is None:
        text = bytes_of(laboratory).decode("utf-8")
        write_atomically(folder / DATA / LABORATORY, text)
    elif on_page != stated.plain_values:
        message = "was made for another laboratory, customer or number"
        raise FileError(folder, f"{message}; give its own {DATA}/{LABORATORY}")
    root = _document(folder, stated, issue_date(stated))
    problems = list(schema_problems(root, schemas))
    if problems:
        raise FileError(folder, [f"schema: {problem}" for problem in problems])
    content = xml_bytes(root if key is None else signed(root, key))
    path = folder / DCC
    with replacing(path) as file:
        file.write(content)
    write_sums(folder, sums_of(folder, (*evidence_files(folder), DCC)))
    return path


def _document(folder: Path, stated: Laboratory, issued: date) -> etree._Element:
    return indented(evidence_text(folder, stated, issued), str(folder / DCC))


def checked_certificate(
    folder: Path, trusted: Sequence[Certificate], schemas: Path | None = None
) -> Checked:
    """Check a certificate of a folder: digests, form, schema, signature, and figures.

    Raises:
        FileError: There is none, or the folder is none of results.
    """
    path = folder / DCC
    content = bytes_of(path)
    root = read_xml(content, str(path))
    problems = list(sums_problems(folder, required=(DCC,)))
    problems += [
        f"{DCC} is invalid: {problem}" for problem in schema_problems(root, schemas)
    ]
    if problems:
        return Checked(tuple(problems))
    problems += sums_problems(folder, evidence_files(folder))
    if xml_bytes(root) != content:
        problems.append(f"{DCC} was altered: it is not as it was written")
    issued = date.fromisoformat(root.findtext(f".//{_ISSUED}") or "")
    signature = checked_signature(root, issued, trusted)
    problems += [f"{DCC} {problem}" for problem in signature.problems]
    for element in root.findall(SIGNATURE):
        root.remove(element)
    etree.indent(root, space=" ")
    stated = read_strict(folder / DATA / LABORATORY, Laboratory)
    expected = _document(folder, stated, issued)
    problems += [
        f"{DCC} was altered, or does not follow from the files: {problem}"
        for problem in _differing(root, expected)
    ]
    schema = "the schema in " + str(schemas) if schemas else "Traverse's part of DCC"
    notes = [*signature.notes, f"keeps to {schema}"]
    return Checked(tuple(problems or evidence_problems(folder)), tuple(notes))


def _differing(stated: etree._Element, expected: etree._Element) -> list[str]:
    """Say where two documents differ first; nothing where they are the same."""
    if xml_bytes(stated) == xml_bytes(expected):
        return []
    for element, other in zip(stated.iter(), expected.iter(), strict=False):
        if element.tag != other.tag or (element.text or "") != (other.text or ""):
            name = etree.QName(other).localname
            text, due = ((each.text or "").strip() for each in (element, other))
            return [f"{name} says {text!r}, the files give {due!r}"]
    return ["their elements differ"]
