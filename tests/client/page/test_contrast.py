"""Contrast of the page's colours by WCAG 2.2: 4.5:1 for text, 3:1 for marks."""

import re
from pathlib import Path

import pytest

import traverse.client.page

HERE = Path(traverse.client.page.__file__).parent
CSS = (HERE / "page.css").read_text("utf-8")
SCENE = (HERE / "arm_scene.js").read_text("utf-8")
TEXT = [
    *((colour, "panel") for colour in ("text", "dim", "good", "warn", "bad", "accent")),
    *((colour, "ground") for colour in ("text", "dim", "good", "warn", "bad")),
    *(("on-fill", f"fill-{level}") for level in ("good", "busy", "bad")),
    ("on-warning", "fill-warning"),
    ("on-good", "good"),
    ("on-accent", "accent"),
]
MARKS = [("line", "panel"), ("line", "ground"), ("accent", "ground")]
SCENE_MARKS = ("link", "joint", "probe", "good", "doubt", "cloud")


def luminance(colour: str) -> float:
    parts = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    linear = [
        c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts
    ]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(colour: str, other: str) -> float:
    """From 1 (the same) to 21 (black on white)."""
    dark, light = sorted((luminance(colour), luminance(other)))
    return (light + 0.05) / (dark + 0.05)


def colours(theme: str) -> dict[str, str]:
    by_name: dict[str, str] = {}
    for selector in (":root", "body.body--light")[: 1 + (theme == "light")]:
        block = CSS[CSS.index(f"{selector} {{") :].partition("}")[0]
        by_name |= dict(re.findall(r"--([a-z-]+): (#[0-9a-f]{6})", block))
    return by_name


def rule(selector: str) -> str:
    match = re.search(rf"{re.escape(selector)} {{ fill: ([^;]+); }}", CSS)
    assert match is not None
    return match[1]


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_text_and_marks_of_the_style_sheet(theme: str) -> None:
    known = colours(theme)
    for pairs, least in ((TEXT, 4.5), (MARKS, 3.0)):
        for colour, other in pairs:
            ratio = contrast(known[colour], known[other])
            assert ratio >= least, (theme, colour, other, round(ratio, 2))


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_where_a_joint_is_stands_out_from_where_it_has_been(theme: str) -> None:
    known = colours(theme)
    marker_colour = rule(f"body.body--{theme} .sectors rect.here")
    assert contrast(marker_colour, known["accent"]) >= 3.0
    # Beside unvisited sectors the frame of the bar is the contrast.
    assert contrast(known["accent"], known["ground"]) >= 3.0


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_marks_of_the_view(theme: str) -> None:
    block = SCENE[SCENE.index(f"{theme}: {{") :].partition("}")[0]
    known = {
        name: f"#{value}"
        for name, value in re.findall(r"(\w+): 0x([0-9a-f]{6})", block)
    }
    for mark in SCENE_MARKS:
        ratio = contrast(known[mark], known["ground"])
        assert ratio >= 3.0, (theme, mark, round(ratio, 2))


def test_levels_and_sounds_differ_by_more_than_colour() -> None:
    from traverse.client.page.banner import ICONS  # noqa: PLC0415

    assert len(set(ICONS.values())) == len(ICONS) == 4
    sounds = (HERE / "sounds.js").read_text("utf-8")
    tones = dict(re.findall(r"^    (\w+): (\[\[.*\]\]),$", sounds, re.MULTILINE))
    assert {"point", "doubt", "refused", "alarm", "cleared"} <= set(tones)
    assert len(set(tones.values())) == len(tones)
