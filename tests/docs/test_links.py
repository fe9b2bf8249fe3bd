"""Every link inside the documentation leads somewhere."""

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


def test_the_map_leads_to_every_page() -> None:
    index = CHECKOUT / "docs" / "index.md"
    linked = {(index.parent / link).resolve() for link in relative_links(index)}
    pages = {page for page in PAGES if page.is_relative_to(index.parent)} - {index}
    assert pages <= linked
