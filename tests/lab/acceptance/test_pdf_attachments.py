"""Files attached to PDF: found again by following the tables, as a reader would."""

import re
import zlib

import pytest

from traverse.lab.acceptance.certificate.pdf_attachments import with_attachments

FILES = {"poses.csv": b"1,2\n" * 500, "a (b).toml": b"", "gr\u00f6\u00dfe.csv": b"\x00"}


def plain_document():
    """One empty page, written by hand."""
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        b"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 9 9] >>",
    ]
    text, places = b"%PDF-1.4\n", []
    for number, content in enumerate(objects, 1):
        places.append(len(text))
        text += b"%d 0 obj\n%b\nendobj\n" % (number, content)
    table = b"xref\n0 4\n0000000000 65535 f \n"
    table += b"".join(b"%010d 00000 n \n" % place for place in places)
    start = len(text)
    trailer = b"trailer\n<< /Size 4 /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % start
    return text + table + trailer


def objects_of(document):
    """Every object by its number, the newest of each."""
    found = {}
    start = int(re.findall(rb"startxref\s+(\d+)", document)[-1])
    while start is not None:
        table = document[start:]
        assert table.startswith(b"xref\n")
        body, _, rest = table.partition(b"trailer")
        lines = iter(body.splitlines()[1:])
        for line in lines:
            first, count = map(int, line.split())
            for number in range(first, first + count):
                place, _, kind = next(lines).split()
                if kind == b"n":
                    text = document[int(place) :]
                    assert text.startswith(b"%d 0 obj" % number)
                    found.setdefault(number, text[: text.index(b"endobj")])
        before = re.search(rb"/Prev (\d+)", rest[: rest.index(b"startxref")])
        start = int(before[1]) if before else None
    return found


def test_files_are_found_by_following_the_tables():
    document = with_attachments(plain_document(), FILES)
    assert document.startswith(plain_document())
    objects = objects_of(document)
    assert b"/Pages 2 0 R" in objects[1]
    names = re.search(rb"/EmbeddedFiles << /Names \[ (.*) \] >>", objects[1])[1]
    found = {}
    for number in map(int, re.findall(rb"(\d+) 0 R", names)):
        spec = objects[number]
        name = re.search(rb"/UF (\(.*\)|<[0-9A-F]+>) /EF", spec)[1]
        content = objects[int(re.search(rb"/EF << /F (\d+)", spec)[1])]
        packed = content.partition(b"stream\n")[2].rpartition(b"\nendstream")[0]
        found[name] = zlib.decompress(packed)
    assert found == {
        b"(poses.csv)": FILES["poses.csv"],
        b"(a \\(b\\).toml)": b"",
        b"<FEFF0067007200F600DF0065002E006300730076>": b"\x00",
    }


def test_nothing_to_attach_changes_nothing():
    assert with_attachments(plain_document(), {}) == plain_document()


@pytest.mark.parametrize(
    ("document", "message"),
    [
        (b"%PDF-1.4\n", "no plain cross-reference table"),
        (with_attachments(plain_document(), FILES), "names files already"),
        (plain_document().replace(b"/Root 1 0 R", b"/Rot  1 0 R"), "no /Root"),
    ],
)
def test_other_documents_are_refused(document, message):
    with pytest.raises(ValueError, match=message):
        with_attachments(document, FILES)
