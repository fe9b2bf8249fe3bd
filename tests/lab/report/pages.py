"""Pages of reports, taken apart."""

import base64
import re
from html.parser import HTMLParser

VOID = {"meta", "img", "br"}


class Page(HTMLParser):
    """Sections, links, images and text of a page; refuses tags that do not close."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.html = html
        self.sections: list[str] = []
        self.links: list[str] = []
        self.images: list[str] = []
        self.open: list[str] = []
        self.words: list[str] = []
        self.cells: list[str] = []
        self.feed(html)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        if tag == "section":
            self.sections.append(values["id"])
        if "href" in values:
            self.links.append(values["href"])
        if tag == "img":
            assert values["alt"]
            self.images.append(values["src"])
        assert tag not in {"script", "link", "iframe", "object", "base"}
        assert not any(name.startswith("on") for name in values)
        if tag not in VOID:
            self.open.append(tag)
        if tag == "td":
            self.cells.append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)
        if self.open and self.open[-1] == "td":
            self.cells[-1] += data

    @property
    def text(self) -> str:
        return " ".join(self.words)

    @property
    def pictures(self) -> list[bytes]:
        """All of them, which must be in the page itself."""
        parts = [source.partition(",") for source in self.images]
        assert all(kind == "data:image/png;base64" for kind, _, _ in parts)
        return [base64.b64decode(data, validate=True) for _, _, data in parts]

    def check_is_self_contained(self) -> None:
        """Check that nothing refers to the outside, and that pictures are whole."""
        data = "data:application/octet-stream;base64,"
        assert all(link.startswith(("#", data)) for link in self.links)
        for png in self.pictures:
            assert png.startswith(b"\x89PNG\r\n\x1a\n")
            assert png.endswith(b"IEND\xaeB`\x82")
            assert b"http" not in png
        without_data = re.sub(r"base64,[^\"]*", "", self.html)
        assert not re.search(r"://|url\(|@import", without_data)
