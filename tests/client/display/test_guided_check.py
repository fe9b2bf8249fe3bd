"""Guided checks: figures against cases with known answers."""

import numpy as np
import pytest

from tests.client.display.values import point
from traverse.client.display.guided_check import GuidedCheck
from traverse.protocol.messages import Point


def check_after(kind: str, places: list[tuple[float, float, float]]) -> GuidedCheck:
    check = GuidedCheck(kind, len(places))
    for seq, place in enumerate(places):
        check.take(point(seq, xyz_mm=list(place), probe_radius_mm=3.0))
    return check


def test_single_points_about_their_mean() -> None:
    # Four points 0.01 from their mean: s^2 = 4 * 1e-4 / 3.
    check = check_after(
        "articulation", [(1.01, 0, 0), (0.99, 0, 0), (1, 0.01, 0), (1, -0.01, 0)]
    )
    figures = {name: value for name, value, _ in check.results}
    assert figures["Largest"] == "0.0100 mm"
    assert figures["2 s"] == f"{2 * np.sqrt(4e-4 / 3):.4f} mm"
    assert figures["Half range"] == "0.0100 / 0.0100 / 0.0000 mm"
    assert check.is_done


def test_a_sphere_with_one_point_out() -> None:
    places = [
        (15.0, 0, 0),
        (-15.0, 0, 0),
        (0, 15.0, 0),
        (0, -15.0, 0),
        (0, 0, 15.0),
        (0, 0, -15.0),
    ]
    figures = {name: value for name, value, _ in check_after("sphere", places).results}
    assert figures["Diameter"] == "24.0000 mm"  # less the ball of 3 mm on both sides
    assert figures["Form"] == "0.0000 mm"


@pytest.mark.parametrize("kind", ["articulation", "sphere"])
def test_too_few_points_give_no_figures_but_say_what_to_do(kind: str) -> None:
    check = GuidedCheck(kind, 5)
    assert check.results == []
    assert "5 more" in check.instruction
    check.take(point(0))
    assert check.results == []
    check.undo("p-0")
    assert "5 more" in check.instruction


SEAT = [(600.0, 0.0, 60.0), (600.0, 0.01, 60.0), (600.01, 0.0, 60.0)]
FINE = {"ok": True, "flags": []}


def touched_at(seq: int, *place: float, **changes: object) -> Point:
    fields = {"xyz_mm": list(place), "probe_radius_mm": 3.0, "quality": FINE, **changes}
    return point(seq, **fields)


def test_a_touch_of_another_seat_does_not_count_until_somebody_says_so() -> None:
    check = GuidedCheck("articulation", 4)
    for seq, place in enumerate(SEAT):
        check.take(touched_at(seq, *place))
    check.take(touched_at(3, 653.0, 0.0, 60.0))
    assert "Point 3 is 53.0 mm off" in check.instruction
    assert len(check.points) == 3
    check.count_in()
    assert check.is_done
    check = GuidedCheck("articulation", 4)
    check.take(touched_at(0, 653.0, 0.0, 60.0))
    check.take(touched_at(1, *SEAT[0]))  # now the first was the wrong one
    check.begin_with_it()
    for seq, place in enumerate(SEAT):
        check.take(touched_at(2 + seq, *place))
    assert check.is_done


def test_a_good_touch_after_a_wrong_one_answers_the_question() -> None:
    check = GuidedCheck("articulation", 3)
    check.take(touched_at(0, *SEAT[0]))
    check.take(touched_at(1, 0.0, 0.0, 0.0))
    check.take(touched_at(2, *SEAT[1]))
    assert check.suspect is None
    assert [p.seq for p in check.points] == [0, 2]


def test_a_touch_beside_the_sphere_is_noticed() -> None:
    places = [(15.0, 0, 0), (-15.0, 0, 0), (0, 15.0, 0), (0, -15.0, 0), (0, 0, 15.0)]
    check = GuidedCheck("sphere", 6)
    for seq, place in enumerate(places):
        check.take(touched_at(seq, *place))
    check.take(touched_at(5, 0.0, 0.0, -25.0))
    assert "10.0 mm off" in check.instruction
    check = GuidedCheck("sphere", 6, diameter_mm=24.0)
    check.take(touched_at(0, 15.0, 0.0, 0.0))
    check.take(touched_at(1, 100.0, 0.0, 0.0))
    assert check.suspect is not None


@pytest.mark.parametrize(
    ("limit_mm", "flags", "level"),
    [
        (None, FINE, "warning"),
        (0.05, FINE, "good"),
        (0.001, FINE, "bad"),
        (0.05, {"ok": False, "flags": ["end_stop"]}, "warning"),
    ],
)
def test_nothing_passes_without_a_limit_or_in_doubt(
    limit_mm: float | None, flags: dict[str, object], level: str
) -> None:
    check = GuidedCheck("articulation", 3, limit_mm)
    assert check.verdict[0] == "busy"
    for seq, place in enumerate(SEAT):
        check.take(touched_at(seq, *place, quality=flags))
    assert check.verdict[0] == level


def test_the_size_of_a_sphere_is_held_against_the_limit_too() -> None:
    places = [(15.0, 0, 0), (-15.0, 0, 0), (0, 15.0, 0), (0, -15.0, 0), (0, 0, 15.0)]
    check = GuidedCheck("sphere", 5, 0.05, diameter_mm=24.1)
    for seq, place in enumerate(places):
        check.take(touched_at(seq, *place))
    assert check.verdict == ("bad", "Failed: error of size 0.1000 mm, limit 0.0500 mm.")
