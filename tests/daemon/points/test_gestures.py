"""Gestures: by hand, and against a definition that looks at all edges at once."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from traverse.daemon.points.buttons import (
    EDGE_DELAY_NS,
    LOST_EDGE_NS,
    ButtonTracker,
    GestureDecision,
    GestureDetector,
    GestureTimes,
)
from traverse.drivers.base.values import CountSamples

MS = 1_000_000
TIMES = GestureTimes(hold_ns=400 * MS, long_ns=1000 * MS, double_ns=300 * MS)
KINDS = [
    frozenset(kinds)
    for kinds in (
        (),
        ("click",),
        ("double",),
        ("hold",),
        ("long",),
        ("click", "double", "hold"),
        ("click", "double", "long"),
    )
]


def decided(meant, *edges_ms, until_ms=10_000):
    """Gestures by press, of presses and releases at alternating times."""
    button = GestureDetector(meant, TIMES)
    decisions = []
    for number, edge_ms in enumerate(edges_ms):
        decisions += button.edge(number % 2 == 0, edge_ms * MS)
    decisions += button.passed(until_ms * MS)
    return [(d.press, d.gesture, d.time_ns // MS) for d in decisions]


ALL = frozenset(("click", "double", "hold"))


@pytest.mark.parametrize(
    ("meant", "edges_ms", "expected"),
    [
        (frozenset(["click"]), (5, 900), [(0, "click", 5)]),
        (frozenset(), (5, 900, 1000, 1010), [(0, "click", 5), (1, "click", 1000)]),
        (ALL, (0, 100), [(0, "click", 400)]),
        (ALL, (0, 100, 400, 450), [(0, "double", 400), (1, "part", 400)]),
        (ALL, (0, 100, 401, 450), [(0, "click", 400), (1, "click", 750)]),
        (ALL, (0, 399), [(0, "click", 699)]),
        (ALL, (0, 400), [(0, "hold", 400)]),
        (ALL, (0, 401), [(0, "hold", 400)]),
        (ALL, (0, 2000), [(0, "hold", 400)]),
        (
            ALL,
            (0, 100, 200, 300, 400, 500),
            [(0, "double", 200), (1, "part", 200), (2, "click", 800)],
        ),
        (ALL, (0, 100, 200, 5000), [(0, "double", 200), (1, "part", 200)]),
        (frozenset(["long"]), (0, 999), [(0, "click", 999)]),
        (frozenset(["long"]), (0, 1000), [(0, "long", 1000)]),
        (frozenset(["double"]), (0, 5000), [(0, "click", 1000)]),
    ],
)
def test_gestures_are_what_they_are_called(meant, edges_ms, expected):
    assert decided(meant, *edges_ms) == expected


def test_a_hold_continues_until_its_release():
    button = GestureDetector(ALL, TIMES)
    button.edge(True, 0)
    assert button.passed(400 * MS - 1) == []
    assert button.passed(400 * MS) == [GestureDecision(0, "hold", 400 * MS)]
    assert button.passed(5000 * MS) == []
    assert button.edge(False, 5001 * MS) == []


def test_what_time_decides_is_due_then():
    button = GestureDetector(ALL, TIMES)
    assert button.due_ns is None
    button.edge(True, 0)
    assert button.due_ns == 400 * MS
    button.edge(False, 100 * MS)
    assert button.due_ns == 400 * MS
    button.passed(401 * MS)
    assert button.due_ns is None


def by_definition(meant, edges_ms):
    """What each press was, from the list of all edges with times that rise."""
    presses = [
        (edges_ms[i], edges_ms[i + 1] if i + 1 < len(edges_ms) else None)
        for i in range(0, len(edges_ms), 2)
    ]
    still = 400 if "hold" in meant else 1000 if "long" in meant else None
    gestures, number = [], 0
    while number < len(presses):
        down, up = presses[number]
        if still is not None and (up is None or up - down >= still):
            gestures.append("hold" if "hold" in meant else "long")
        elif "double" in meant and (up is None or up - down >= 1000):
            gestures.append("click")
        elif (
            "double" in meant
            and number + 1 < len(presses)
            and presses[number + 1][0] - up <= 300
        ):
            gestures += ["double", "part"]
            number += 1
        else:
            gestures.append("click")
        number += 1
    return gestures


@given(
    meant=st.sampled_from(KINDS),
    gaps=st.lists(
        st.integers(1, 1500)
        | st.sampled_from([299, 300, 301, 399, 400, 401, 999, 1000]),
        max_size=14,
    ),
    looks=st.lists(st.integers(0, 14 * 1500), max_size=10),
)
def test_every_press_is_decided_once_and_as_defined(meant, gaps, looks):
    edges_ms = [sum(gaps[: i + 1]) for i in range(len(gaps))]
    end = (edges_ms or [0])[-1] + 5000
    button, decisions = GestureDetector(meant, TIMES), []
    edges = sorted([(at_ms, 1, n) for n, at_ms in enumerate(edges_ms)])
    edges += [(at_ms, 0, -1) for at_ms in looks if at_ms not in edges_ms]
    for at_ms, is_edge, number in sorted(edges):
        if is_edge:
            decisions += button.edge(number % 2 == 0, at_ms * MS)
        else:
            decisions += button.passed(at_ms * MS)
    decisions += button.passed(end * MS)
    gestures = {d.press: d.gesture for d in decisions}
    assert len(gestures) == len(decisions)
    expected = by_definition(meant, edges_ms)
    assert [gestures.get(n) for n in range(len(expected))] == expected
    assert button.presses == len(expected)


@given(
    meant=st.sampled_from(KINDS),
    edges=st.lists(st.tuples(st.booleans(), st.integers(1, 1500)), max_size=14),
)
def test_no_press_is_lost_or_decided_twice_where_edges_are_lost(meant, edges):
    button, decisions, now = GestureDetector(meant, TIMES), [], 0
    for active, gap in edges:
        now += gap * MS
        decisions += button.edge(active, now)
    decisions += button.edge(False, now + 1)
    decisions += button.passed(now + 10_000 * MS)
    assert sorted(d.press for d in decisions) == list(range(button.presses))


class LateEdges:
    """A button whose board streams levels each 10 ms, and keeps edges for a while."""

    WHICH = ("base", 1)

    def __init__(self):
        meanings = {"click": "point", "double": "undo", "hold": "scan"}
        self.buttons = ButtonTracker({self.WHICH: meanings}, TIMES)

    def stream(self, begin_ms, end_ms, *, active_ms=()):
        """Let samples arrive; the button is active within ``active_ms``."""
        times_ms = np.arange(begin_ms, end_ms, 10)
        n = len(times_ms)
        active = np.zeros(n, dtype=np.bool_)
        for down_ms, up_ms in active_ms:
            active |= (times_ms >= down_ms) & (times_ms < up_ms)
        self.buttons.follow_levels(
            CountSamples(
                "base",
                1,
                times_ms // 10,
                times_ms,
                end_ms * MS,
                times_ms * MS,
                (active << 1).astype(np.uint8) | 1,
                np.zeros((n, 1), dtype=np.uint32),
                np.zeros((n, 1), dtype=np.uint8),
            )
        )

    def down(self, time_ms):
        return self.buttons.down(self.WHICH, time_ms * MS)

    def up(self, time_ms):
        self.buttons.up(self.WHICH, time_ms * MS)

    def passed(self, now_ms):
        self.buttons.passed(now_ms * MS)


def test_a_release_that_its_board_keeps_back_ends_no_hold():
    late = LateEdges()
    press = late.down(1000)
    late.stream(1000, 1900, active_ms=[(1000, 1030), (1700, 1900)])
    late.passed(1900)
    assert press.gesture is None
    late.up(1030)
    late.down(1700)
    assert press.gesture == "click"


def test_a_second_press_that_its_board_keeps_back_makes_a_double():
    late = LateEdges()
    press = late.down(1000)
    late.up(1030)
    late.stream(1000, 1900, active_ms=[(1000, 1030), (1100, 1140)])
    late.passed(1900)
    assert press.gesture is None
    late.down(1100)
    assert press.gesture == "double"


def test_a_hold_is_certain_once_samples_reach_its_time():
    late = LateEdges()
    press = late.down(1000)
    late.stream(1000, 1390, active_ms=[(1000, 1500)])
    late.passed(1900)  # a busy computer reads late: a release may be among the bytes
    assert press.gesture is None
    late.stream(1390, 1500, active_ms=[(1000, 1500)])
    late.passed(1901)
    assert press.gesture == "hold"


def test_an_edge_that_never_comes_is_waited_for_no_longer_than_its_limit():
    late = LateEdges()
    press = late.down(1000)
    late.stream(1000, 1500, active_ms=[(1000, 1030)])
    limit_ms = 1400 + (LOST_EDGE_NS + EDGE_DELAY_NS) // MS
    late.passed(limit_ms - 1)
    assert press.gesture is None
    late.passed(limit_ms)
    assert press.gesture == "hold"
