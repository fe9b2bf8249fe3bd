"""Files attached to a PDF document that has none: an incremental update at its end.

As of ISO 32000-1: 7.5.6 (incremental updates), 7.11.4 (embedded files), 7.7.4 (names).
The document must have a plain cross-reference table, as matplotlib writes it.
"""

import re
import zlib
from collections.abc import Mapping

_ROOT = re.compile(rb"/Root (\d+) 0 R")
_SIZE = re.compile(rb"/Size (\d+)")
_START = re.compile(rb"startxref\s+(\d+)\s+%%EOF\s*$")
_INFO = re.compile(rb"/Info \d+ 0 R")


def with_attachments(document: bytes, files: Mapping[str, bytes]) -> bytes:
    """Attach files to a document.

    Args:
        document: A PDF without embedded files.
        files: Contents by name.

    Raises:
        ValueError: The document is not of the kind that can be added to.
    """
    if not files:
        return document
    start, trailer = _trailer(document)
    root, size = _ROOT.search(trailer), _SIZE.search(trailer)
    info = _INFO.search(trailer)
    if root is None or size is None:
        raise ValueError("the document's trailer has no /Root or no /Size")
    number = int(root[1])
    found = re.findall(rb"(?s)\n%d 0 obj\s*<<(.*?)>>\s*endobj" % number, document)
    if not found or b"/Names" in found[-1]:  # the newest counts
        raise ValueError("the document's catalog is missing, or names files already")
    objects: dict[int, bytes] = {}
    following = int(size[1])
    pairs = []
    for name, content in sorted(files.items()):
        packed = zlib.compress(content)
        objects[following] = (
            b"<< /Type /EmbeddedFile /Filter /FlateDecode /Length %d"
            b" /Params << /Size %d >> >>\nstream\n%b\nendstream"
            % (len(packed), len(content), packed)
        )
        objects[following + 1] = (
            b"<< /Type /Filespec /F %b /UF %b /EF << /F %d 0 R >> >>"
            % (_text(name), _text(name), following)
        )
        pairs.append(b"%b %d 0 R" % (_text(name), following + 1))
        following += 2
    names = b"/Names << /EmbeddedFiles << /Names [ %b ] >> >>" % b" ".join(pairs)
    objects[number] = b"<<%b %b >>" % (found[-1].rstrip(), names)
    ends = b"/Size %d /Root %d 0 R /Prev %d" % (following, number, start)
    if info is not None:
        ends += b" " + info[0]
    return document + _update(objects, len(document), ends)


def _trailer(document: bytes) -> tuple[int, bytes]:
    """Say where the cross-reference table starts, and take the trailer after it."""
    last = _START.search(document)
    if last is None or not document[int(last[1]) :].startswith(b"xref"):
        raise ValueError("the document has no plain cross-reference table at its end")
    start = int(last[1])
    return start, document[document.rindex(b"trailer") :]


def _update(objects: Mapping[int, bytes], offset: int, ends: bytes) -> bytes:
    """Write objects, their table and the trailer, beginning at an offset."""
    body, places = b"\n", {}
    for number in sorted(objects):
        places[number] = offset + len(body)
        body += b"%d 0 obj\n%b\nendobj\n" % (number, objects[number])
    table = b"xref\n0 1\n0000000000 65535 f \n"
    for number, place in places.items():
        table += b"%d 1\n%010d 00000 n \n" % (number, place)
    return (
        body
        + table
        + b"trailer\n<< %b >>\nstartxref\n%d\n%%%%EOF\n" % (ends, offset + len(body))
    )


def _text(name: str) -> bytes:
    """Write a name as a string of PDF: as it is, or as hexadecimal UTF-16."""
    if name.isascii() and name.isprintable():
        escaped = re.sub(r"([\\()])", r"\\\1", name)
        return b"(%b)" % escaped.encode("ascii")
    return b"<FEFF%b>" % name.encode("utf-16-be").hex().upper().encode("ascii")
