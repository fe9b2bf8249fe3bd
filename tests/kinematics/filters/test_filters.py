"""Filters against plain loops, and the same however a stream is cut."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from traverse.kinematics.filters import FILTERS, FilterChain, PointBlock, PointFilter
from traverse.kinematics.filters.sections import Sections
from traverse.kinematics.filters.selections import Ball, Box, Slab, Speed, Unflagged
from traverse.kinematics.filters.thinning import BallSpacing, Distance, GridSpacing

STEP_NS = 1_000_000


def block_of(xyz_mm, quality=None, time_ns=None) -> PointBlock:
    xyz_mm = np.asarray(xyz_mm, dtype=np.float64).reshape(-1, 3)
    n = len(xyz_mm)
    return PointBlock(
        np.arange(n),
        np.arange(n) * STEP_NS if time_ns is None else np.asarray(time_ns),
        xyz_mm,
        np.tile([0.0, 0.0, 1.0], (n, 1)),
        np.arange(2.0 * n).reshape(n, 2),
        np.arange(2 * n).reshape(n, 2),
        np.zeros(n, np.uint32) if quality is None else np.array(quality, np.uint32),
        np.arange(6.0 * n).reshape(n, 6),
    )


MAKERS = {
    "box": lambda: Box((-2, -2, -2), (2, 1, 3)),
    "sphere": lambda: Ball((0.5, 0, 0), 2.0, outside=True),
    "slab": lambda: Slab((1, 1, 0), -1.0, 2.0),
    "speed": lambda: Speed(max_mm_s=1500.0),
    "quality": lambda: Unflagged(allowed=2),
    "distance": lambda: Distance(1.5),
    "grid": lambda: GridSpacing(1.3),
    "spacing": lambda: BallSpacing(1.5),
    "sections": lambda: Sections((0.3, 1, 0), 0.7, 0.1),
}

places = arrays(
    np.float64,
    st.tuples(st.integers(0, 40), st.just(3)),
    elements=st.floats(-5, 5) | st.just(math.nan),
)
walks = places.map(lambda steps: np.cumsum(0.4 * np.nan_to_num(steps), axis=0))


def test_every_filter_is_in_the_table_and_tried_here():
    assert set(FILTERS) == set(MAKERS)
    for kind, make in MAKERS.items():
        assert type(make()) is FILTERS[kind]


@pytest.mark.parametrize("kind", MAKERS)
@settings(max_examples=60)
@given(xyz_mm=places | walks, data=st.data())
def test_cutting_a_stream_into_blocks_changes_nothing(kind, xyz_mm, data):
    quality = data.draw(st.lists(st.integers(0, 3), min_size=40, max_size=40))
    undivided = block_of(xyz_mm, quality[: len(xyz_mm)])
    cuts = sorted(data.draw(st.lists(st.integers(0, len(xyz_mm)), max_size=6)))
    at_once, in_parts = MAKERS[kind](), MAKERS[kind]()
    expected = at_once.apply(undivided)
    bounds = [0, *cuts, len(xyz_mm)]
    parts = [in_parts.apply(undivided.rows(slice(a, b))) for a, b in pairwise(bounds)]
    got = PointBlock.joined(parts)
    for name in ("seq", "time_ns", "xyz_mm", "angles_rad", "counts", "quality"):
        np.testing.assert_array_equal(getattr(got, name), getattr(expected, name))


@given(places)
def test_regions_are_what_their_definitions_say(xyz_mm):
    block = block_of(xyz_mm)
    for row, (x, y, z) in enumerate(block.xyz_mm.tolist()):
        single_row = block.rows(slice(row, row + 1))
        known = not any(map(math.isnan, (x, y, z)))
        in_box = -1 <= x <= 1 and -2 <= y <= 2 and 0 <= z <= 3
        assert len(Box((-1, -2, 0), (1, 2, 3)).apply(single_row)) == in_box
        assert len(Box((-1, -2, 0), (1, 2, 3), outside=True).apply(single_row)) == (
            known and not in_box
        )
        in_ball = x * x + (y - 1) ** 2 + z * z <= 4
        assert len(Ball((0, 1, 0), 2).apply(single_row)) == in_ball
        in_slab = -3 <= z <= 0.5
        assert len(Slab((0, 0, 5), -3, 0.5).apply(single_row)) == (known and in_slab)


def test_a_sample_without_a_value_does_not_hide_how_far_a_path_has_been():
    xyz_mm = [(1, 0, 0), (0, 0, 0), (math.nan, 0, 0), (0, 0, 0), (1, 0, 0)]
    passed = MAKERS["sections"]().apply(block_of(xyz_mm))
    assert passed.seq.tolist() == [1, 3]


@given(walks | places)
def test_spacing_by_balls_keeps_what_a_plain_loop_keeps(xyz_mm):
    kept: list[int] = []
    for row, point in enumerate(xyz_mm):
        away = [math.dist(point, xyz_mm[other]) for other in kept]
        if not np.isnan(point).any() and all(d**2 >= 1.5**2 for d in away):
            kept.append(row)
    assert BallSpacing(1.5).apply(block_of(xyz_mm)).seq.tolist() == kept


@given(walks | places)
def test_distance_keeps_what_a_plain_loop_keeps(xyz_mm):
    kept: list[int] = []
    for row, point in enumerate(xyz_mm):
        if not np.isnan(point).any() and (
            not kept or np.sum((point - xyz_mm[kept[-1]]) ** 2) >= 0.8**2
        ):
            kept.append(row)
    assert Distance(0.8).apply(block_of(xyz_mm)).seq.tolist() == kept


@given(places)
def test_a_grid_holds_one_point_a_cell(xyz_mm):
    cells: dict[tuple[int, ...], int] = {}
    for row, point in enumerate(xyz_mm.tolist()):
        if not any(map(math.isnan, point)):
            cells.setdefault(tuple(math.floor(c / 1.3) for c in point), row)
    assert GridSpacing(1.3).apply(block_of(xyz_mm)).seq.tolist() == list(cells.values())


def test_what_spacing_remembers_is_bounded_and_what_it_forgets_is_counted():
    line = np.column_stack([np.arange(100.0), np.zeros(100), np.zeros(100)])
    for made in (GridSpacing(1.0, max_cells=10), BallSpacing(1.0, max_cells=10)):
        assert len(made.apply(block_of(line))) == 100
        assert made.forgotten == 90
        assert len(made.apply(block_of(line[-5:]))) == 0  # the youngest are known
        assert len(made.apply(block_of(line[:1]))) == 1
        made.restart()
        assert len(made.apply(block_of(line[-5:]))) == 5


def test_speed_is_that_of_the_step_that_led_to_a_point():
    # 1 mm/ms, then 3 mm/ms, then at rest.
    block = block_of([[0, 0, 0], [1, 0, 0], [4, 0, 0], [4, 0, 0]])
    assert Speed(max_mm_s=1000.0).apply(block).seq.tolist() == [1, 3]
    assert Speed(min_mm_s=500.0).apply(block).seq.tolist() == [1, 2]
    same_instant = block_of([[0, 0, 0], [1, 0, 0]], time_ns=[5, 5])
    assert len(Speed(max_mm_s=1e9).apply(same_instant)) == 0


def test_crossings_lie_on_their_planes_and_on_the_path():
    rng = np.random.default_rng(4)
    path = np.cumsum(rng.normal(size=(400, 3)), axis=0)
    normal = np.array([1.0, 2.0, -2.0]) / 3
    passed = Sections((3, 6, -6), 2.5, 0.4, clearance_mm=1e-9).apply(block_of(path))
    assert len(passed) > 50
    planes = (passed.xyz_mm @ normal - 0.4) / 2.5
    np.testing.assert_allclose(planes, np.rint(planes), atol=1e-9)
    share = (passed.time_ns % STEP_NS) / STEP_NS
    step = passed.time_ns // STEP_NS
    on_path = path[step] + share[:, np.newaxis] * (path[step + 1] - path[step])
    np.testing.assert_allclose(passed.xyz_mm, on_path, atol=1e-5)
    # As many as the changes of the number of the slice, which a loop counts.
    slices = np.floor((path @ normal - 0.4) / 2.5)
    assert len(passed) == int(np.abs(np.diff(slices)).sum())
    assert (np.diff(passed.time_ns) >= 0).all()


def test_a_probe_that_rests_on_a_plane_crosses_it_once():
    rng = np.random.default_rng(5)
    heights = np.concatenate([np.linspace(-3.5, 0, 50), 0.005 * rng.normal(size=500)])
    path = np.column_stack([heights, np.zeros(550), np.zeros(550)])
    assert len(Sections((1, 0, 0), 1.0).apply(block_of(path))) == 4
    back = np.column_stack([np.linspace(0, -0.5, 9), np.zeros(9), np.zeros(9)])
    repeated = Sections((1, 0, 0), 1.0)
    repeated.apply(block_of(path))
    assert len(repeated.apply(block_of(np.vstack([back, back[::-1]])))) == 1


def test_nothing_is_interpolated_across_a_gap():
    path = [[0.5, 0, 0], [1.5, 0, 0], [2.5, 0, 0]]
    gap = block_of(path, time_ns=[0, 500_000_000, 501_000_000])
    (only,) = Sections((1, 0, 0), 1.0).apply(gap).xyz_mm.tolist()
    assert only == [2.0, 0.0, 0.0]


def test_a_chain_applies_all_and_counts_what_each_holds_back():
    rng = np.random.default_rng(6)
    path = np.cumsum(0.1 * rng.normal(size=(3000, 3)), axis=0)
    filters: list[PointFilter] = [make() for make in MAKERS.values()]
    chain = FilterChain(filters)
    block = block_of(path, rng.integers(0, 4, 3000))
    passed = chain.apply(block)
    for make in MAKERS.values():
        block = make().apply(block)
    np.testing.assert_array_equal(passed.xyz_mm, block.xyz_mm)
    assert chain.interpolates
    assert not FilterChain(filters[:8]).interpolates
    assert sum(chain.removed) <= 3000
    chain.restart()
    np.testing.assert_array_equal(
        chain.apply(block_of(path, np.zeros(3000))).xyz_mm,
        FilterChain([make() for make in MAKERS.values()])
        .apply(block_of(path, np.zeros(3000)))
        .xyz_mm,
    )


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: Box((0, 0, 1), (1, 1, 0)), "exchange them"),
        (lambda: Ball((0, 0, 0), 0.0), "radius_mm is 0"),
        (lambda: Slab((0, 0, 0), 0, 1), "normal is"),
        (lambda: Slab((0, 0, 1), 2, 1), "not below"),
        (lambda: Speed(max_mm_s=-1.0), "max_mm_s -1"),
        (lambda: Distance(math.nan), "spacing_mm is nan"),
        (lambda: GridSpacing(-1.0), "spacing_mm is -1"),
        (lambda: BallSpacing(math.inf), "spacing_mm is inf"),
        (lambda: Sections((0, 0, 1), 0.0), "spacing_mm is 0"),
        (lambda: Sections((0, 0, math.nan), 1.0), "normal is"),
    ],
)
def test_impossible_settings_are_refused_by_name(make, reason):
    with pytest.raises(ValueError, match=reason):
        make()
