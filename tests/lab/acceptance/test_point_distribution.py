"""How touches are spread: what is remarked, and what is not."""

import numpy as np
import pytest

from tests.lab.measurements import artefact, measured, touches
from traverse.lab.acceptance.procedures.point_distribution import (
    direction_remarks,
    half_sphere_remarks,
)
from traverse.simulator.campaigns.acceptance.layout import DIRECTIONS, PATTERN_25

CENTRE = np.array([300.0, -200.0, 50.0])


def remarks_of(outwards):
    touched = touches(CENTRE + 15.0 * outwards, [""] * len(outwards))
    return list(half_sphere_remarks(touched, CENTRE, "probing-1"))


@pytest.mark.parametrize("seed", range(5))
def test_the_pattern_of_25_is_good_whichever_way_it_is_turned(seed):
    rotation, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    assert remarks_of(PATTERN_25 @ rotation.T) == []


def test_a_cap_is_not_a_half_sphere():
    cap = PATTERN_25[:17]  # up to 67.5 degrees
    assert remarks_of(cap[:13]) == [
        "probing-1: points go to 45 degrees from their middle, expected about 90"
    ]


def test_a_hole_is_seen():
    # Along one great circle only: nothing to its left and right.
    kept = PATTERN_25[np.abs(PATTERN_25[:, 0]) < 0.2]
    (remark,) = remarks_of(kept)
    assert "has no point within" in remark


def lengths(directions):
    entries = []
    for number, way in enumerate(directions):
        name = f"L-{number}"
        points = {"a": (0.0, 0.0, 0.0), "b": (100.0, 0.0, 0.0)}
        bar = artefact(name, "points", frame="own", points_mm=points)
        ends = [CENTRE, CENTRE + 100.0 * way / np.linalg.norm(way)]
        entries.append((bar, touches(ends, ["a", "b"])))
    data = measured(*entries)
    return list(direction_remarks(data, list(data.artefacts)))


def test_seven_directions_are_good():
    assert lengths(DIRECTIONS) == []


def test_lengths_in_one_plane_are_reported():
    flat = DIRECTIONS * [1.0, 1.0, 0.0] + [1e-3, 0.0, 0.0]
    (remark,) = lengths(flat)
    assert "cosine 0.00" in remark
    assert "1.00)" in remark
