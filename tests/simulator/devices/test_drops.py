"""When samples are dropped, and why."""

from tests.simulator.one_hinge import Notebook
from traverse.simulator.devices.latch_board.device import DropCounter


def test_drops_in_a_row_are_one_note_with_what_came_before_them():
    notes = Notebook()
    drops = DropCounter("base", notes)
    for now_s, n_dropped in ((1.0, 0), (3.5, 900), (3.6, 20), (3.7, 0), (3.8, 4)):
        drops.live(now_s)
        drops.count(n_dropped)
    assert [(*one[:3], round(one[3], 9)) for one in notes.drops] == [
        ("base", 920, 3.5, 2.5)
    ]
    drops.finish()
    drops.finish()
    assert [one[1] for one in notes.drops] == [920, 4]
