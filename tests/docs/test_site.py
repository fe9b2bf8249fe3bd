import html
import os
import re
import shutil
from dataclasses import fields
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag

import pytest
from playwright.async_api import async_playwright, expect

from tests.docs.pages import CHECKOUT, COMMANDS, PAGES
from tests.running import run_program
from traverse.cli.common.broker_options import BrokerOptions

pytestmark = pytest.mark.slow


class Parts(HTMLParser):
    """Resources of a page of the site, and targets of its navigation."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.navigation: set[str] = set()
        self.feed(page.read_text("utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = {name: value or "" for name, value in attrs}
        if tag in ("script", "img", "iframe", "source"):
            self.loaded.append(attributes.get("src", ""))
        elif tag == "link":
            self.loaded.append(attributes.get("href", ""))
        elif tag == "a" and "md-nav__link" in attributes.get("class", ""):
            self.navigation.add(urldefrag(attributes.get("href", ""))[0])


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("docs") / "site"
    # Not a part of the make that may run this.
    inherited = {k: v for k, v in os.environ.items() if not k.startswith("MAKE")}
    # The environment that runs this is not made anew, even if pyproject.toml is newer.
    words = ("make", "--silent", "--old-file=.venv/.ready", "docs", f"SITE={folder}")
    ran = run_program(*words, cwd=CHECKOUT, env=inherited)
    assert ran.stdout + ran.stderr == ""
    return folder


def page_in(site: Path, page: Path) -> Path:
    docs = CHECKOUT / "docs"
    if not page.is_relative_to(docs):
        page = docs / "checkout" / page.relative_to(CHECKOUT)
    name = "index" if page.name == "README.md" else page.stem
    return (site / page.relative_to(docs)).with_name(f"{name}.html")


def test_navigation_leads_to_every_page(site: Path) -> None:
    start = site / "index.html"
    led = {(site / link).resolve() for link in Parts(start).navigation if link}
    readme = CHECKOUT / "README.md"  # what index.md is for the site
    expected = {page_in(site, page) for page in PAGES if page != readme}
    assert expected - led - {start} == set()
    assert all(page.exists() for page in expected)


def test_nothing_is_fetched_from_elsewhere(site: Path) -> None:
    pages = sorted(site.rglob("*.html"))
    assert len(pages) >= len(PAGES)
    for page in pages:
        for link in Parts(page).loaded:
            assert not re.match(r"(https?:)?//", link), f"{page}: {link}"
    for style in site.rglob("*.css"):
        assert not re.search(r"url\(\s*['\"]?(https?:)?//", style.read_text("utf-8"))


def test_every_link_within_the_site_leads_to_a_file(site: Path) -> None:
    """Strict mkdocs does not look at files of the checkout."""
    for page in site.rglob("*.html"):
        if page.name == "404.html":  # its links are for wherever it is shown
            continue
        for link in re.findall(r'(?:href|src)="([^"]+)"', page.read_text("utf-8")):
            path = unquote(urldefrag(html.unescape(link))[0])
            if path and not re.match(r"\w+:", path):
                assert (page.parent / path).is_file(), f"{page}: {link}"


def test_lists_have_become_lists(site: Path) -> None:
    """Markdown's readers differ: here a list needs an empty line before it."""
    for page in site.rglob("*.html"):
        text = re.sub(r"<pre.*?</pre>", "", page.read_text("utf-8"), flags=re.DOTALL)
        for paragraph in re.findall(r"<p>(.*?)</p>", text, re.DOTALL):
            assert not re.search(r"^ *([-*]|\d+\.) ", paragraph, re.M), page
            assert "```" not in paragraph, page


def test_every_command_is_followed_by_the_options_of_its_help(site: Path) -> None:
    page = (site / "reference" / "commands.html").read_text("utf-8")
    _, *parts = re.split(r"<h2 id=\S+?><code>(traverse.*?)</code>", page)
    sections = dict(zip(parts[::2], parts[1::2], strict=True))
    assert set(sections) == set(COMMANDS)
    for name, command in COMMANDS.items():
        rows = re.findall(r"<td>(.*?)</td>\n<td>", sections[name])
        words = html.unescape(" ".join(re.findall(r"<code>(.*?)</code>", str(rows))))
        shown = set(re.findall(r"(?<!\S)--?[a-z][a-z-]*", words))
        if any('href="#brokers"' in row for row in rows):
            shown |= {
                f"--{declared.name.replace('_', '-')}"
                for declared in fields(BrokerOptions)
            }
        assert shown == {
            option
            for parameter in command.params
            if parameter.param_type_name == "option"
            for option in (*parameter.opts, *parameter.secondary_opts)
        } - {"--help", "-h"}, name


@pytest.mark.needs("chromium")
async def test_pages_work_in_a_browser_from_files(site: Path) -> None:
    """The search asks nobody; a console is copied without prompts and answers."""
    urls: list[str] = []
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = await browser.new_page()
        page.on("request", lambda request: urls.append(request.url))
        await page.goto((site / "index.html").as_uri())
        await page.locator("input.md-search__input").fill("outbox")
        first = page.locator(".md-search-result__item h1").first
        await expect(first).to_have_text("Outbox", timeout=20_000)
        await page.goto((site / "tutorial" / "first-light.html").as_uri())
        block = page.locator(".highlight code", has_text="mosquitto_pub -t test")
        # What the site's button does before it takes the text.
        copied = await block.evaluate(
            "it => { it.setAttribute('data-md-copying', ''); return it.innerText }"
        )
        await browser.close()
    assert all(url.startswith(("file:", "data:", "blob:")) for url in urls), urls
    assert copied.strip() == "mosquitto_pub -t test -m hello && echo works"
