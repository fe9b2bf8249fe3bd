"""Templates of reports: sentences, pages that escape, values that are missing."""

from pathlib import Path

import pytest
from jinja2 import UndefinedError

from traverse.lab.report import templates
from traverse.lab.report.quantities import millimetres, often, shown_unit
from traverse.plurals import counted

WORDS = """\
{% macro two(name) %}
One is
{{ name }},{# no space before the comma #}
{% if name %} and more{% endif %}.

  Two is indented
and goes on.
{% endmacro %}
"""
PAGE = """\
{% extends "report/frame.jinja" %}
{% import "report/macros.jinja" as ui %}
{% block title %}{{ name }}{% endblock %}
{% block body %}
{{ ui.paragraphs(words.lines("two", name)) }}
{{ ui.table([name], [[name]]) }}
{{ ui.figure(png, name) }}
{% endblock %}
"""
HOSTILE = '<i>"A" & co</i>'


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of templates in place of the lab's, with the lab's frame."""
    shared = Path(templates.__file__).parent
    (tmp_path / "report").symlink_to(shared)
    (tmp_path / "words.jinja").write_text(WORDS)
    (tmp_path / "page.jinja").write_text(PAGE)
    monkeypatch.setattr(templates, "_LAB", tmp_path)
    return tmp_path


def test_a_blank_line_ends_a_sentence_and_the_first_line_says_how_far_it_is_indented(
    folder: Path,
) -> None:
    words = templates.Words("words.jinja")
    assert words.lines("two", "a & b") == [
        "One is a & b, and more.",
        "  Two is indented and goes on.",
    ]


def test_a_page_escapes_values_and_the_sentences_made_of_them(folder: Path) -> None:
    words = templates.Words("words.jinja")
    text = templates.page("page.jinja", {}, words=words, name=HOSTILE, png=b"\x89")
    assert "<i>" not in text
    assert "&#34;A&#34; &amp; co" in text
    # Title, heading, sentence, head of the table, its cell, description of the picture.
    assert text.count("&lt;i&gt;") == 6


def test_a_value_that_is_missing_is_refused(folder: Path) -> None:
    words = templates.Words("words.jinja")
    with pytest.raises(UndefinedError, match="name"):
        templates.page("page.jinja", {}, words=words, png=b"")


def test_numbers_of_things_and_prefixes() -> None:
    assert [counted(n, "pose") for n in (0, 1, 2)] == ["0 poses", "1 pose", "2 poses"]
    assert [often(n) for n in (1, 2, 3)] == ["once", "twice", "3 times"]
    assert shown_unit(0.02, "mm/C") == (1e3, "µm/°C")
    assert shown_unit(0.0, "rad") == (1.0, "rad")
    assert shown_unit(1e-15, "mm") == (1e9, "pm")


@pytest.mark.parametrize(
    ("value_mm", "expanded_mm", "text"),
    [
        # Two digits of U (GUM 7.2.6), at least a tenth of a micrometre.
        (0.027639, 0.00085, "0.02764"),
        (-0.02403, 0.00123, "-0.0240"),
        (-0.02403, 0.0123, "-0.0240"),
        (0.006312, None, "0.0063"),
        (0.006312, 0.0, "0.0063"),
        (None, 0.001, ""),
    ],
)
def test_lengths_have_the_digits_of_their_uncertainty(value_mm, expanded_mm, text):
    assert millimetres(value_mm, expanded_mm) == text
    signed = millimetres(value_mm, expanded_mm, "+")
    assert signed == (f"+{text}" if value_mm and value_mm > 0.0 else text)
