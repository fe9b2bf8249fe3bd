"""Condition equations of every kind of artefact: derivatives, starts, meaning."""

import numpy as np
import pytest

from tests.lab.simulated import (
    WIRE_OFFSET_MM,
    random_directions,
    read_lengths,
    targets_of,
)
from traverse.lab.artefacts import ARTEFACT_KINDS, artefact_from_table
from traverse.lab.artefacts.artefact import Touches

TABLES = [
    {"kind": "cone"},
    {"kind": "seats", "distance_mm": 50.0},
    {
        "kind": "seats",
        "distances": [
            {"between": ["A", "B"], "distance_mm": 50.0, "distance_std_mm": 0.01},
            {"between": ["A", "C"], "distance_mm": 80.0},
        ],
    },
    {"kind": "draw_wire"},
    {"kind": "draw_wire", "offset_mm": WIRE_OFFSET_MM, "offset_std_mm": 0.1},
    {"kind": "sphere"},
    {"kind": "sphere", "radius_mm": 25.0, "radius_std_mm": 0.001, "side": "inside"},
    {"kind": "ball_bar", "radius_mm": [12.0, 15.0], "distance_mm": 300.0},
    {"kind": "plane"},
    {"kind": "parallel_planes", "distance_mm": 100.0},
    {"kind": "parallel_planes", "distance_mm": 100.0, "side": "inside"},
]
NET = {"A": [0.0, 0, 0], "B": [100.0, 0, 0], "C": [0.0, 80, 0], "D": [10.0, 20, 90]}
TABLES += [
    {"kind": "points", "frame": frame, "points_mm": NET, **more}
    for frame in ("arm", "own", "own_scaled")
    for more in ({}, {"points_std_mm": 0.01})
]


def made(table, seed=1, n=40, growth=0.0):
    """An artefact, true ball centres, and the touches."""
    rng = np.random.default_rng(seed)
    full = {"id": "x", **table}
    place = np.array([300.0, -200.0, 150.0])
    centres, names = targets_of(full, rng, n, place)
    artefact = artefact_from_table(full)
    listed = artefact.features or ("",)
    features = np.array([listed.index(name) for name in names])
    unknown = np.full((n, 3), np.nan)
    growths = np.full(n, growth)
    lengths = read_lengths(full, centres, place)
    touches = Touches(features, growths, unknown, 3.0, listed, lengths)
    return artefact, centres, touches


def test_every_kind_is_tested_here():
    assert {table["kind"] for table in TABLES} == set(ARTEFACT_KINDS)


@pytest.mark.parametrize("table", TABLES)
def test_derivatives_agree_with_central_differences(table):
    artefact, centres, touches = made(table, growth=2e-3)
    rng = np.random.default_rng(2)
    state = artefact.start(centres, touches)
    step = rng.normal(size=len(artefact.unknown_scales(touches))) * 0.01
    state = artefact.moved(state, step)
    centres = centres + rng.normal(size=centres.shape)
    linear = artefact.equations(state, centres, touches)
    small = 1e-4
    for component, unit in enumerate(np.eye(3) * small):
        plus = artefact.equations(state, centres + unit, touches).misclosures_mm
        minus = artefact.equations(state, centres - unit, touches).misclosures_mm
        slope = (plus - minus) / (2 * small)
        assert np.allclose(linear.by_centre[:, :, component], slope, atol=1e-6)
    for unknown, unit in enumerate(np.eye(len(step)) * small):
        ahead, behind = artefact.moved(state, unit), artefact.moved(state, -unit)
        plus = artefact.equations(ahead, centres, touches).misclosures_mm
        minus = artefact.equations(behind, centres, touches).misclosures_mm
        slope = (plus - minus) / (2 * small)
        assert np.allclose(
            linear.by_unknowns[:, :, unknown], slope, rtol=1e-6, atol=1e-5
        )
        plus = artefact.certificate(ahead, touches).misclosures_mm
        minus = artefact.certificate(behind, touches).misclosures_mm
        slope = (plus - minus) / (2 * small)
        certificate = artefact.certificate(state, touches)
        assert np.allclose(certificate.by_unknowns[:, unknown], slope, atol=1e-6)
        for length, longer, shorter in zip(
            *(artefact.lengths(at) for at in (state, ahead, behind)), strict=True
        ):
            slope = (longer.value_mm - shorter.value_mm) / (2 * small)
            assert length.by_unknowns[unknown] == pytest.approx(slope, abs=1e-6)


@pytest.mark.parametrize("table", TABLES)
def test_the_start_closes_exact_data_and_its_certificate(table):
    artefact, centres, touches = made(table)
    state = artefact.start(centres, touches)
    at_start = artefact.equations(state, centres, touches)
    assert np.allclose(at_start.misclosures_mm, 0.0, atol=1e-7)
    certified = artefact.certificate(state, touches)
    assert np.allclose(certified.misclosures_mm, 0.0, atol=1e-6)


@pytest.mark.parametrize("table", TABLES)
def test_the_start_survives_a_few_blunders(table):
    artefact, centres, touches = made(table)
    rng = np.random.default_rng(5)
    centres[:3] += 2.0 * random_directions(rng, 3)
    state = artefact.start(centres, touches)
    left_mm = artefact.equations(state, centres, touches).misclosures_mm[3:]
    assert np.sqrt(np.median(left_mm**2)) < 0.3


@pytest.mark.parametrize("table", TABLES)
def test_each_certificate_can_be_left_out(table):
    artefact, centres, touches = made(table)
    for name in artefact.certified_lengths:
        without = artefact.without_certificate(name)
        left = {*artefact.certified_lengths} - {name}
        assert set(without.certified_lengths) == left
        assert without.features == artefact.features
        state = without.start(centres, touches)
        observed = [
            np.count_nonzero(np.isfinite(standard.certificate(at, touches).std_mm))
            for standard, at in (
                (artefact, artefact.start(centres, touches)),
                (without, state),
            )
        ]
        assert observed[1] < observed[0]
        assert name in {length.name for length in without.lengths(state)}
        assert len(without.unknown_scales(touches)) == len(
            artefact.unknown_scales(touches)
        )


@pytest.mark.parametrize("table", TABLES)
def test_equations_leave_their_inputs_alone(table):
    artefact, centres, touches = made(table)
    state = artefact.start(centres, touches)
    for array in (state, centres, touches.features, touches.growths):
        array.setflags(write=False)
    artefact.equations(state, centres, touches)
    artefact.certificate(state, touches)
    artefact.moved(state, np.full(len(artefact.unknown_scales(touches)), 1e-3))


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({}, "needs distance_mm"),
        ({"distance_mm": 5.0, "distances": [["A", "B"]]}, "distances"),
        (
            {"distances": [{"between": ["A", "A"], "distance_mm": 5.0}]},
            "'A' has a distance to itself",
        ),
        (
            {
                "distances": [
                    {"between": list(p), "distance_mm": 5.0} for p in ("AB", "BA")
                ]
            },
            "two distances between the same seats",
        ),
    ],
)
def test_distances_of_seats_that_make_no_sense_are_refused(table, message):
    with pytest.raises(ValueError, match=message):
        artefact_from_table({"id": "x", "kind": "seats", **table})


def test_a_warm_bar_is_longer_about_its_middle():
    table = {"kind": "ball_bar", "radius_mm": 10.0, "distance_mm": 500.0}
    artefact, centres, touches = made(table)
    state = artefact.start(centres, touches)
    warm = Touches(
        touches.features, np.full(40, 1e-3), touches.directions, 3.0, ("1", "2")
    )
    # Both centres move outwards by 500 e-3 / 2 mm, and the radii grow by 0.01 mm.
    along = state[3:6] - state[:3]
    outwards = np.where(touches.features[:, None] == 0, -along, along) / 500.0
    place = state[:6].reshape(2, 3)[touches.features]
    grown = place + 0.25 * outwards + (centres - place) * (13.01 / 13.0)
    left_mm = artefact.equations(state, grown, warm).misclosures_mm
    assert np.allclose(left_mm, 0.0, atol=1e-9)


def test_directions_tell_the_sides_of_a_plate_touched_from_both():
    rng = np.random.default_rng(4)
    centres = rng.uniform(-100, 100, (30, 3))
    above = np.arange(30) % 2 == 0
    centres[:, 2] = np.where(above, 3.0, -3.0)
    directions = np.where(above[:, None], [0, 0, -1.0], [0, 0, 1.0])
    plane = artefact_from_table({"id": "p", "kind": "plane"})
    touches = Touches(np.zeros(30, int), np.zeros(30), directions, 3.0, ("",))
    state = plane.start(centres, touches)
    left_mm = plane.equations(state, centres, touches).misclosures_mm
    assert np.allclose(left_mm, 0.0, atol=1e-12)
    assert abs(state[3]) < 1e-12


def test_a_nearly_flat_patch_of_a_sphere_keeps_its_side():
    rng = np.random.default_rng(6)
    up = np.column_stack([rng.normal(size=(20, 2)) * 0.05, np.ones(20)])
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    centres = np.array([100.0, 200, 300]) + 28.0 * up
    sphere = artefact_from_table({"id": "s", "kind": "sphere", "radius_mm": 25.0})
    touches = Touches(
        np.zeros(20, int), np.zeros(20), np.full((20, 3), np.nan), 3.0, ("",)
    )
    state = sphere.start(centres, touches)
    assert state[:3] == pytest.approx([100, 200, 300], abs=0.01)


def test_three_touches_lie_on_two_balls():
    artefact, centres_mm, touches = made(
        {"kind": "ball_bar", "radius_mm": 12.0, "distance_mm": 300.0}, seed=4, n=6
    )
    state = artefact.start(centres_mm, touches)
    images = artefact.mirror_images(state, centres_mm, touches)
    assert len(images) == 3  # of one ball, of the other, of both
    for image in images:
        assert np.max(np.abs(image - state)) > 1.0
        left_mm = artefact.equations(image, centres_mm, touches).misclosures_mm
        assert np.max(np.abs(left_mm)) < 1e-6


@pytest.mark.parametrize(
    "table", [{"kind": "sphere"}, {"kind": "sphere", "radius_mm": 25.0}]
)
def test_a_ball_touched_all_over_is_where_it_is(table):
    artefact, centres_mm, touches = made(table, n=12)
    state = artefact.start(centres_mm, touches)
    assert artefact.mirror_images(state, centres_mm, touches) == ()
