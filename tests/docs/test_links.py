"""Every link inside the documentation leads somewhere; tables are whole."""

import re
from pathlib import Path

import pytest

from tests.docs.pages import CHECKOUT, PAGES, anchors, name_of, relative_links


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_resolve(page: Path) -> None:
    broken = []
    for link in relative_links(page):
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        leads_out = not target.is_relative_to(CHECKOUT)
        if (
            leads_out
            or not target.exists()
            or (anchor and anchor not in anchors(target))
        ):
            broken.append(link)
    assert not broken


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_row_of_a_table_has_the_cells_of_its_head(page: Path) -> None:
    text = re.sub(r"^ *```.*?^ *```$", "", page.read_text("utf-8"), flags=re.S | re.M)
    for table in re.findall(r"(?:^ *\|.*\|\n)+", text, re.M):
        bars = {row: len(re.findall(r"(?<!\\)\|", row)) for row in table.splitlines()}
        assert len(set(bars.values())) == 1, bars


def test_the_map_leads_to_every_page() -> None:
    index = CHECKOUT / "docs" / "index.md"
    linked = {(index.parent / link).resolve() for link in relative_links(index)}
    pages = {page for page in PAGES if page.is_relative_to(index.parent)} - {index}
    assert pages <= linked
