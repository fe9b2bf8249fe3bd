import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from traverse.daemon.scans.selection import MAX_EDGES, ButtonGate

BUTTON, OTHER = ("base", 0), ("handle", 3)


def held(gate, *times_ns):
    return gate.held(np.array(times_ns, dtype=np.int64)).tolist()


def test_the_instant_of_a_press_is_held_and_that_of_a_release_is_not():
    gate = ButtonGate()
    gate.edge(BUTTON, 100, True)
    gate.edge(BUTTON, 200, False)
    assert held(gate, 99, 100, 199, 200, 201) == [False, True, True, False, False]


def test_without_an_edge_nothing_is_held():
    assert held(ButtonGate(), 1, 2) == [False, False]


def test_any_of_several_buttons_holds():
    gate = ButtonGate()
    gate.edge(BUTTON, 10, True)
    gate.edge(OTHER, 15, True)
    gate.edge(BUTTON, 20, False)
    gate.edge(OTHER, 30, False)
    assert held(gate, 9, 12, 22, 29, 30) == [False, True, True, True, False]


def test_it_remembers_so_many_edges_and_no_more():
    gate = ButtonGate()
    for k in range(3 * MAX_EDGES):
        gate.edge(BUTTON, k, k % 2 == 0)
    last = 3 * MAX_EDGES - 1
    assert held(gate, last - 1, last) == [True, False]
    assert held(gate, 0) == [False]  # long forgotten


@given(
    st.lists(st.tuples(st.integers(0, 40), st.booleans()), unique_by=lambda e: e[0]),
    st.randoms(use_true_random=False),
)
def test_levels_are_those_of_the_last_edge_in_whatever_order_edges_come(edges, random):
    gate = ButtonGate()
    shuffled = list(edges)
    random.shuffle(shuffled)
    for time_ns, level in shuffled:
        gate.edge(BUTTON, time_ns, level)
    for time_ns in range(42):
        before = [level for at_ns, level in sorted(edges) if at_ns <= time_ns]
        assert held(gate, time_ns) == [before[-1] if before else False]
