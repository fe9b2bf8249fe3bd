"""Articulation and volume by hand."""

import re

import numpy as np
import pytest

from tests.docs.pages import CHECKOUT
from tests.lab.acceptance.test_lengths import seats
from tests.lab.measurements import (
    artefact,
    limits,
    measured,
    of_kind,
    touches,
)
from traverse.kinematics.arm_file.arm import read_arm
from traverse.lab.acceptance.conformity import Figure, LengthError, Missing
from traverse.lab.acceptance.plan import plan_of
from traverse.lab.acceptance.procedures.b89 import (
    N_BARS,
    ZONES,
    articulation,
    volumetric,
)
from traverse.lab.measured_points.measurement import reach_of

SIDES = ["left"] * 5 + ["right"] * 5
PLACES = {"near": 100.0, "middle": 500.0, "far": 900.0}


def cones(offsets_by_zone, places=PLACES, sides=SIDES):
    entries = []
    for zone in ZONES:
        at = np.array([places[zone], 0.0, 0.0])
        offsets = offsets_by_zone.get(zone, np.zeros((10, 3)))
        cone = artefact(f"spat-{zone}", "cone")
        entries.append((cone, touches(at + np.array(offsets), sides[: len(offsets)])))
    return measured(*entries)


def test_articulation_by_hand():
    # Five points 3 um to one side, five to the other: delta = 3 um each.
    far = [[0, 0.003, 0]] * 5 + [[0, -0.003, 0]] * 5
    # Nine points together and one 10 um off: delta 9 um of the one, 1 um of the rest.
    near = [[0, 0, 0]] * 9 + [[0.010, 0, 0]]
    parts = list(articulation(cones({"far": far, "near": near}), limits()))
    largest, two_s = (of_kind(parts, Figure, key) for key in ("spat_max", "spat_2s"))
    assert largest.value_mm == pytest.approx(0.009, abs=1e-9)
    figures = dict(largest.parts)
    assert figures["far"] == pytest.approx(0.003, abs=1e-9)
    assert figures["far, (max - min)/2 y"] == pytest.approx(0.003, abs=1e-9)
    assert figures["near, (max - min)/2 x"] == pytest.approx(0.005, abs=1e-9)
    expected = {
        "near": 2e-3 * np.sqrt((9 * 1 + 81) / 9),
        "middle": 0.0,
        "far": 2e-3 * np.sqrt(10 * 9 / 9),
    }
    assert dict(two_s.parts) == pytest.approx(expected, abs=1e-9)
    assert two_s.value_mm == pytest.approx(2e-3 * np.sqrt(10), abs=1e-9)
    assert largest.remarks == ()


def test_zone_and_elbow_are_watched():
    data = cones({}, {**PLACES, "near": 300.0}, ["left"] * 10)
    figure = of_kind(articulation(data, limits()), Figure, "spat_max")
    assert "spat-near is at 30% of the reach, expected 0% to 20%" in figure.remarks
    assert sum("elbow" in remark for remark in figure.remarks) == 3


def test_nine_touches_are_too_few():
    (missing,) = of_kind(
        articulation(cones({"far": np.zeros((9, 3))}), limits()), Missing
    )
    assert missing.what == ("spat-far: 1 point is missing of 10",)


def bars(errors_mm):
    entries = []
    for number, error in enumerate(errors_mm):
        length_mm = 600.0 if number < 10 else 1300.0
        bar, touched = seats(f"volumetric-{number + 1:02d}", length_mm, [error])
        sign = 1 - 2 * np.array([number % 2, number // 2 % 2, number // 4 % 2])
        moved = touches(
            touched.places_mm + 700.0 * sign - [300.0, 0, 0], touched.features
        )
        entries.append((bar, moved))
    return measured(*entries)


def test_volumetric_by_hand():
    errors = [0.003, -0.005] + [0.001, -0.001] * 9
    permitted = limits(volumetric_max_mm=0.005, volumetric_2rms_mm=0.003)
    parts = list(volumetric(bars(errors), permitted))
    largest = of_kind(parts, Figure, "volumetric_max")
    two_rms = of_kind(parts, Figure, "volumetric_2rms")
    assert largest.value_mm == pytest.approx(-0.005, abs=1e-9)
    assert two_rms.value_mm == pytest.approx(2e-3 * np.sqrt((9 + 25 + 18) / 20))
    mean = -0.002 / 20
    twice = 2 * np.std(errors, ddof=1)
    expected = {"mean": mean, "twice the standard deviation": twice}
    assert dict(largest.parts) == pytest.approx(expected, abs=1e-9)
    assert two_rms.decision.verdict == "reject"
    assert len(of_kind(parts, LengthError)) == 20
    (remark,) = largest.remarks  # all bars here lie along x
    assert "hardly go along" in remark


def test_bars_must_be_all_there():
    data = bars([0.0] * 20)
    del data.touched["volumetric-07"]
    (missing,) = volumetric(data, limits())
    assert missing.what == ("volumetric-07: was not measured",)


def test_the_plan_tells_twenty_different_positions():
    arm = read_arm(CHECKOUT / "cli" / "demo_data" / "arm.toml")
    steps = plan_of("asme-b89.4.22", arm).steps
    instruction = re.compile(
        r"bar of (\d+) mm, position (\d+) of 20: (.*), its middle (\d+) mm .* octant "
        r"(. . .) of x y z"
    )
    positions = {
        step.artefact: match.groups()
        for step in steps
        if (match := instruction.match(step.say)) is not None
    }
    assert [int(number) for _, number, *_ in positions.values()] == [
        *range(1, N_BARS + 1)
    ]
    assert len({(length, *where) for length, _, *where in positions.values()}) == N_BARS
    for length in {length for length, *_ in positions.values()}:
        octants = {where[-1] for of, *where in positions.values() if of == length}
        assert len(octants) == 8
    # Wherever it lies there, the whole bar is in the reach.
    _, reach_mm = reach_of(arm)
    for length, _, _, away, _ in positions.values():
        assert float(away) + 0.5 * float(length) < 0.97 * reach_mm
