"""Errors of length by hand, and the rule for repeats."""

from dataclasses import replace

import numpy as np
import pytest

from tests.lab.measurements import (
    OCTAHEDRON,
    SURE_MM,
    TIP_MM,
    artefact,
    limits,
    measured,
    of_kind,
    on_a_ball,
    touches,
)
from traverse.lab.acceptance.conformity import Figure, LengthError, Missing
from traverse.lab.acceptance.procedures.length_tests import (
    check_names,
    interim_test,
    length_names,
    length_test,
)
from traverse.lab.acceptance.procedures.lengths import errors_of

SQUARE = np.array([[5.0, 5, 0], [-5, 5, 0], [-5, -5, 0], [5, -5, 0]])


def seats(name, length_mm, errors_mm, **keys):
    """A bar with two seats, touched at both ends for every repeat."""
    points = {"a": (0.0, 0.0, 0.0), "b": (length_mm, 0.0, 0.0)}
    keys = {"points_std_mm": SURE_MM, **keys}
    bar = artefact(name, "points", frame="own", points_mm=points, **keys)
    places = [
        place
        for error in errors_mm
        for place in ([7.0, 1, 2], [7.0 + length_mm + error, 1, 2])
    ]
    return bar, touches(places, ["a", "b"] * len(errors_mm))


@pytest.mark.parametrize("kind", ["points", "seats"])
def test_two_seats_by_hand(kind):
    bar, touched = seats("L", 500.0, [0.01, -0.02, 0.0])
    if kind == "seats":
        known = {"between": ("a", "b"), "distance_mm": 500.0}
        bar = artefact("L", "seats", distances=(known,))
    data = measured((bar, touched))
    errors = errors_of(data, "L", "e_uni", limits())
    assert [e.error_mm for e in errors] == pytest.approx([0.01, -0.02, 0.0], abs=1e-12)
    assert [e.repeat for e in errors] == [1, 2, 3]


def test_ball_bar_by_hand_with_expansion():
    bar = artefact(
        "L",
        "ball_bar",
        radius_mm=(10.0, 12.0),
        distance_mm=300.0,
        distance_std_mm=4e-4,
        expansion_per_c=1e-5,
        expansion_std_per_c=1e-6,
    )
    grown = 1.0 + 1e-5 * 10.0
    places, features = [], []
    for error in (0.003, -0.001):
        end = [300.0 * grown + error, 0.0, 0.0]
        for feature, centre, radius in (("2", end, 12.0), ("1", [0, 0, 0], 10.0)):
            places.append(on_a_ball(centre, radius * grown, OCTAHEDRON))
            features += [feature] * 6
    data = measured((bar, touches(np.concatenate(places), features, 30.0)))
    standards = {"temperature_std_c": 0.1}
    errors = errors_of(data, "L", "e_uni", limits(standards=standards))
    assert [e.error_mm for e in errors] == pytest.approx([0.003, -0.001], abs=1e-10)
    # 4e-4 of the certificate; 300 x 1e-6 x 10 = 3e-3; 300 x 1e-5 x 0.1 = 3e-4.
    expected = np.sqrt(4e-4**2 + 3e-3**2 + 3e-4**2)
    assert errors[0].standard_mm == pytest.approx(expected)


def test_parallel_planes_by_hand():
    block = artefact("L", "parallel_planes", distance_mm=100.0)
    top = [0, 0, 100.005 + 2 * TIP_MM]
    places = np.concatenate([SQUARE, SQUARE + top])
    data = measured((block, touches(places, ["1"] * 4 + ["2"] * 4)))
    (error,) = errors_of(data, "L", "e_bi", limits())
    assert error.error_mm == pytest.approx(0.005, abs=1e-12)


@pytest.mark.parametrize(
    ("features", "message"),
    [
        (["1"] * 8, "1 run of touches, ending with feature 1"),
        (["1"] * 6 + ["2"] * 2, "on face 2: 2 points"),
    ],
)
def test_planes_need_both_faces(features, message):
    block = artefact("L", "parallel_planes", distance_mm=100.0)
    places = np.concatenate([SQUARE, SQUARE + np.array([0, 0, 106.0])])
    data = measured((block, touches(places, features)))
    with pytest.raises(ValueError, match=message):
        errors_of(data, "L", "e_bi", limits())


def all_sets(changed=None, length_mm=lambda number: 300.0 * number):
    """All 35 sets without error, but for some."""
    changed = changed or {}
    entries = []
    for name in length_names("uni"):
        number = int(name[-1])
        errors = changed.get(name, [0.0, 0.0, 0.0])
        entries.append(seats(name, length_mm(number), errors))
    return measured(*entries)


def judged(changed, **keys):
    permitted = limits(e_uni_mm=0.010, **keys)
    return of_kind(length_test(all_sets(changed), "e_uni", permitted), Figure, "e_uni")


def test_no_errors_are_accepted():
    figure = judged({})
    assert figure.value_mm == pytest.approx(0.0, abs=1e-9)
    assert figure.decision.verdict == "accept"
    (remark,) = figure.remarks  # all lengths here lie along x
    assert "hardly go along" in remark
    parts = list(length_test(all_sets(), "e_uni", limits()))
    assert len(of_kind(parts, LengthError)) == 105
    assert of_kind(parts, Figure, "e_uni").decision is None


def test_largest_size_counts_with_its_sign():
    figure = judged({"uni-2-3": [0.004, -0.009, 0.0]})
    assert figure.value_mm == pytest.approx(-0.009, abs=1e-9)
    assert figure.decision.verdict == "accept"


def test_one_of_three_outside_waits_for_ten_repeats():
    figure = judged({"uni-2-3": [0.0, 0.012, 0.0]})
    assert figure.decision.verdict == "neither"
    assert "uni-2-3: measure each ten times again" in figure.remarks[0]


def test_ten_good_repeats_cure_one_of_three():
    figure = judged({"uni-2-3": [0.0, 0.012, 0.0] + [0.009] * 10})
    assert figure.decision.verdict == "accept"
    assert "measured ten times again, good" in figure.remarks[0]
    assert figure.value_mm == pytest.approx(0.012, abs=1e-9)


@pytest.mark.parametrize(
    "changed",
    [
        {"uni-2-3": [0.0, 0.012, 0.011]},  # two of three
        {"uni-2-3": [0.0, 0.012, 0.0] + [0.0] * 9 + [0.011]},  # a repeat outside
        {f"uni-{p}-1": [0.0, 0.012, 0.0] for p in range(1, 7)},  # six sets
        {f"uni-{p}-1": [0.0, 0.012, 0.0] + [0.0] * 10 for p in range(1, 7)},
    ],
)
def test_more_is_rejected(changed):
    assert judged(changed).decision.verdict == "reject"


def test_five_cured_sets_are_the_most():
    changed = {f"uni-{p}-1": [0.0, 0.012, 0.0] + [0.0] * 10 for p in range(1, 6)}
    assert judged(changed).decision.verdict == "accept"


def test_an_uncertainty_that_is_not_stated_leaves_undecided():
    data = all_sets().touched
    bars = {
        name: artefact(
            name,
            "points",
            frame="own",
            points_mm={"a": (0.0, 0.0, 0.0), "b": (300.0 * int(name[-1]), 0.0, 0.0)},
        )
        for name in data
    }
    plain = replace(all_sets(), artefacts=bars)
    figure = of_kind(
        length_test(plain, "e_uni", limits(e_uni_mm=0.010)), Figure, "e_uni"
    )
    assert (figure.decision.verdict, figure.decision.guard_mm) == ("undecided", None)
    assert figure.budget.standard_mm is None


def test_what_is_missing_is_listed_and_nothing_computed():
    data = all_sets({"uni-1-1": [0.0, 0.0], "uni-7-5": [0.0] * 4})
    data = measured(
        *(
            (data.artefacts[name], data.of(name))
            for name in data.artefacts
            if name != "uni-3-3"
        )
    )
    (missing,) = length_test(data, "e_uni", limits())
    assert isinstance(missing, Missing)
    assert missing.what == (
        "uni-1-1: was measured 2 times, expected 3, or 13 with ten again",
        "uni-3-3: is not among the artefacts",
        "uni-7-5: was measured 4 times, expected 3, or 13 with ten again",
    )


def test_too_few_lengths_are_remarked():
    data = all_sets(length_mm=lambda number: 200.0)
    figure = of_kind(length_test(data, "e_uni", limits()), Figure, "e_uni")
    assert "1 different lengths, expected 5" in figure.remarks[0]


def test_limit_that_grows_with_the_length():
    limit = {"constant_mm": 0.005, "per_m_mm": 0.010, "most_mm": 0.012}
    data = all_sets({"uni-1-1": [0.0079, 0.0, 0.0], "uni-1-5": [0.0119, 0.0, 0.0]})
    parts = list(length_test(data, "e_uni", limits(e_uni_mm=limit)))
    assert of_kind(parts, Figure, "e_uni").decision.verdict == "accept"
    limits_mm = {e.artefact: e.limit_mm for e in of_kind(parts, LengthError)}
    assert limits_mm["uni-1-1"] == pytest.approx(0.008)
    assert limits_mm["uni-1-5"] == pytest.approx(0.012)


def test_interim_check_by_hand():
    errors = {name: [0.001, -0.002, 0.0] for name in check_names()}
    errors["check-4"] = [0.002, 0.006, 0.003]
    data = measured(*(seats(name, 600.0, e) for name, e in errors.items()))
    parts = list(interim_test(data, limits(interim_length_mm=0.005)))
    figure = of_kind(parts, Figure, "interim_length")
    assert figure.value_mm == pytest.approx(0.006, abs=1e-9)
    assert figure.decision.verdict == "reject"
    expected = {
        "mean error": (6 * -0.001 + 0.011) / 21,
        "range of all errors": 0.008,
        "largest range within a position": 0.004,
    }
    assert dict(figure.parts) == pytest.approx(expected, abs=1e-9)
    # Where the limit grows, a short bar may exceed its own by a smaller error.
    lengths = {name: 300.0 if name == "check-2" else 900.0 for name in errors}
    errors["check-2"] = [0.005, 0.0, 0.0]
    data = measured(*(seats(name, lengths[name], e) for name, e in errors.items()))
    growing = limits(interim_length_mm={"constant_mm": 0.001, "per_m_mm": 0.010})
    figure = of_kind(interim_test(data, growing), Figure, "interim_length")
    assert (figure.decision.verdict, figure.value_mm) == (
        "reject",
        pytest.approx(0.005),
    )
    # Each by its own uncertainty, which has to be stated of all.
    of_one = dict(data.artefacts)
    of_one["check-6"] = of_one["check-6"].model_copy(update={"points_std_mm": None})
    figure = of_kind(
        interim_test(replace(data, artefacts=of_one), limits(interim_length_mm=0.01)),
        Figure,
        "interim_length",
    )
    assert figure.decision.verdict == "undecided"
    (missing,) = interim_test(measured(seats("check-1", 600.0, [0.0])), limits())
    assert len(missing.what) == 7
