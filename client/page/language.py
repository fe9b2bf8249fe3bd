"""The choice of the page's language; `language.js` replaces texts in the browser."""

from pathlib import Path

from nicegui import Client, ui

from traverse.client.page.controls import Dialogs

CATALOGUE = Path(__file__).parent / "languages.tsv"
CATALOGUE_URL = "/languages.tsv"
COMMA, POINT = "Decimal comma", "Decimal point"


def language_names() -> dict[str, str]:
    with CATALOGUE.open(encoding="utf-8") as catalogue:
        codes, names = (next(catalogue).rstrip("\n").split("\t") for _ in range(2))
    return dict(zip(codes, names, strict=True))


def add_languages() -> None:
    """Let the browser translate the page that is being built."""
    script = CATALOGUE.with_name("language.js").read_text("utf-8")
    begin = f"traverse_language.begin({CATALOGUE_URL!r})"
    ui.add_body_html(f"<script>{script}{begin}</script>")


async def choose_language(dialogs: Dialogs, client: Client) -> None:
    """Ask for language and decimal sign; the browser remembers them."""
    names = language_names()
    answer, _ = await dialogs.ask(
        "The page in which language?",
        (*names.values(), COMMA, POINT),
        details="Numbers keep the point unless you choose the comma.",
    )
    if answer in (COMMA, POINT):
        has_comma = str(answer == COMMA).lower()
        client.run_javascript(
            f"traverse_language.use(traverse_language.code, {has_comma})"
        )
    elif answer:
        (code,) = (code for code, name in names.items() if name == answer)
        client.run_javascript(
            f"traverse_language.use({code!r}, traverse_language.has_comma)"
        )
