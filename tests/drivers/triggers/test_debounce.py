from hypothesis import given
from hypothesis import strategies as st

from traverse.drivers.triggers.trigger_driver import Debounce, DebouncedEdge

HOLD_NS = 5_000_000
MS = 1_000_000


def played(changes, hold_ns=HOLD_NS, active=False):
    """Edges reported for changes (level, ms), long after the last of them."""
    debounce = Debounce(hold_ns, active=active)
    results = [debounce.change(level, round(ms * MS)) for level, ms in changes]
    results.append(debounce.settle(10**15))
    return [edge for edge in results if edge is not None]


def test_a_bouncing_contact_is_one_edge_at_its_first_touch():
    bounces = [(True, 10), (False, 10.2), (True, 10.5), (False, 11), (True, 11.8)]
    assert played(bounces) == [DebouncedEdge(True, 10 * MS)]
    released = [(False, 60), (True, 60.1), (False, 60.3)]
    edges = [DebouncedEdge(True, 10 * MS), DebouncedEdge(False, 60 * MS)]
    assert played(bounces + released) == edges


def test_a_glitch_is_no_edge():
    assert played([(True, 10), (False, 10.1)]) == []
    assert played([(False, 10), (True, 13)], active=True) == []


def test_an_edge_is_reported_when_it_has_held_and_not_before():
    debounce = Debounce(HOLD_NS, active=False)
    assert debounce.due_ns is None
    assert debounce.change(True, 10 * MS) is None
    assert debounce.due_ns == 15 * MS
    assert debounce.settle(15 * MS - 1) is None
    assert debounce.settle(15 * MS) == DebouncedEdge(True, 10 * MS)
    assert debounce.due_ns is None


def test_without_holding_every_change_is_an_edge():
    changes = [(True, 1), (False, 2), (True, 2.001)]
    edges = played(changes, hold_ns=0)
    assert edges == [DebouncedEdge(level, round(ms * MS)) for level, ms in changes]


@given(
    st.lists(st.tuples(st.booleans(), st.integers(0, 40)), max_size=30), st.booleans()
)
def test_edges_alternate_in_order_and_end_at_the_last_level(steps, begin):
    at_ms, changes = 0, []
    for level, gap_ms in steps:
        at_ms += gap_ms
        changes.append((level, at_ms))
    edges = played(changes, active=begin)
    levels = [edge.active for edge in edges]
    assert all(a != b for a, b in zip([begin, *levels], levels, strict=False))
    times_ns = [edge.time_ns for edge in edges]
    assert times_ns == sorted(times_ns)
    last = changes[-1][0] if changes else begin
    assert (levels[-1] if levels else begin) == last
