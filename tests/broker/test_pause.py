import pytest

from traverse.broker.pause import LASTING_S, GrowingPause


def test_it_doubles_until_a_connection_has_lasted():
    pause = GrowingPause(0.2, 5.0, jitter=lambda: 1.0)
    outcomes = [None, 0.0, 1.0, None, 9.0, 3.0, LASTING_S, None]
    pauses = [pause.after(lasted_s) for lasted_s in outcomes]
    assert pauses == pytest.approx([0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 0.2, 0.4])


def test_connections_that_do_not_last_are_counted():
    pause = GrowingPause(0.2, 5.0)
    counts = []
    for lasted_s in (0.0, None, 1.0, LASTING_S, None, 2.0):
        pause.after(lasted_s)
        counts.append(pause.n_short_lived)
    assert counts == [1, 1, 2, 0, 0, 1]


def test_jitter_shortens_it_by_half_at_most():
    pauses = {GrowingPause(2.0, 5.0).after(None) for _ in range(50)}
    assert len(pauses) > 1
    assert all(1.0 <= pause_s <= 2.0 for pause_s in pauses)
