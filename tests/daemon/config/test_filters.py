import pytest
from pydantic import ValidationError

from traverse.daemon.config.filters import FilterSection, flag_bits
from traverse.daemon.config.schema import ScanSection
from traverse.kinematics.filters.selections import Box
from traverse.protocol.messages import QualityFlag
from traverse.strict_toml.problems import FileError
from traverse.strict_toml.reader import parse_strict


def section(text):
    return parse_strict(text, "daemon.toml", ScanSection)


def test_tables_become_filters_in_their_order():
    read = section(
        '[[filters]]\nkind = "box"\nlow_mm = [0, 0, 0]\nhigh_mm = [1, 2, 3]\n'
        '[[filters]]\nkind = "speed"\nmax_mm_s = 50\n'
    )
    box, speed = (filter_.create() for filter_ in read.filters)
    assert box == Box((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))
    assert (speed.max_mm_s, speed.min_mm_s) == (50.0, 0.0)


def test_all_mistakes_are_told_at_once_with_their_places():
    text = (
        '[[filters]]\nkind = "sphere"\ncentre_mm = [0, 0]\nradius_mm = 5\n'
        '[[filters]]\nkind = "grid"\nspacing = 5\n'
        '[[filters]]\nkind = "gird"\nspacing_mm = 5\n'
        '[[filters]]\nkind = "spacing"\nspacing_mm = 0\n'
        '[[filters]]\nkind = "quality"\nallowed = ["lat"]\n'
    )
    with pytest.raises(FileError) as caught:
        section(text)
    said = str(caught.value)
    for words in (
        "filters[0].centre_mm",
        "filters[1].spacing",
        "filters[1].spacing_mm",
        "gird",
        "filters[3]",
        "expected a finite number above 0",
        "filters[4]",
        "late",
    ):
        assert words in said


def test_a_filter_needs_its_keys():
    with pytest.raises(ValidationError, match="radius_mm"):
        FilterSection.from_table({"kind": "sphere", "centre_mm": (0.0, 0.0, 0.0)})


def test_flags_have_the_names_of_the_messages():
    assert flag_bits(["late", "skew"]) == QualityFlag.LATE | QualityFlag.SKEW
