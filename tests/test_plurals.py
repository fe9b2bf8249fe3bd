import pytest

from traverse.plurals import counted


@pytest.mark.parametrize(
    ("count", "noun", "verb", "expected"),
    [
        (1, "point", "", "1 point"),
        (0, "pose", "", "0 poses"),
        (2, "touch", "", "2 touches"),
        (3, "entry", "", "3 entries"),
        (1, "pose", "contradict", "1 pose contradicts"),
        (2, "pose", "contradict", "2 poses contradict"),
        (1, "sample", "were", "1 sample was"),
        (1.0, "turn", "are", "1 turn is"),
        (0.5, "turn", "", "0.5 turns"),
        (4096, "more combination", "", "4096 more combinations"),
    ],
)
def test_nouns_and_verbs_agree_with_the_number(
    count: float, noun: str, verb: str, expected: str
) -> None:
    assert counted(count, noun, verb) == expected
