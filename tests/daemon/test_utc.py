"""Whether UTC is believed: what is possible, what is remembered, what is confirmed."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.daemon.values import SetClock
from traverse.daemon.utc import (
    DAY_NS,
    LATEST_NS,
    MADE_NS,
    MAX_AWAY_NS,
    UtcFile,
    UtcJudge,
    UtcMemory,
    as_text,
    is_synchronised,
)
from traverse.daemon.utc_watch import LOOK_NS, UtcWatch

SOON_NS = MADE_NS + 30 * DAY_NS
YEAR_NS = 365 * DAY_NS


def judge(*, good_ns=0, confirmed_ns=0, synchronised=False):
    return UtcJudge(UtcMemory(good_ns, confirmed_ns), lambda: synchronised)


@pytest.mark.parametrize("synchronised", [False, True])
@pytest.mark.parametrize(
    ("utc_ns", "cause"),
    [
        (40 * 10**9, "shows 1970-01-01 00:00 UTC, before this version was made"),
        (MADE_NS - 1, "before this version was made"),
        (MADE_NS + 9 * YEAR_NS, "more than 5 years after"),
        (2**62, "more than 5 years after"),
    ],
)
def test_what_cannot_be_is_doubted_whatever_the_kernel_says(
    utc_ns, cause, synchronised
):
    assert cause in judge(synchronised=synchronised).doubt(utc_ns)


def test_a_laboratory_without_a_network_confirms_its_time_once():
    its = judge()
    assert "no program keeps it synchronised, and nobody has" in its.doubt(SOON_NS)
    assert its.unverified(SOON_NS) == (
        "the computer's clock shows 2026-12-01 00:00 UTC"
    )
    its.confirm(SOON_NS)
    assert its.unverified(SOON_NS) == ""
    assert its.doubt(SOON_NS) == ""
    assert its.doubt(SOON_NS + 300 * DAY_NS) == ""  # after a long summer


def test_a_clock_that_runs_back_or_is_far_ahead_is_doubted_unless_it_is_kept():
    back, ahead = SOON_NS - DAY_NS, SOON_NS + MAX_AWAY_NS + DAY_NS
    assert "has shown 2026-12-01 00:00 UTC before" in judge(good_ns=SOON_NS).doubt(back)
    assert "401 days after it was last right" in judge(good_ns=SOON_NS).doubt(ahead)
    for utc_ns in (back, ahead):
        assert judge(good_ns=SOON_NS, synchronised=True).doubt(utc_ns) == ""


def test_a_time_in_doubt_is_not_remembered():
    its = judge(good_ns=SOON_NS)
    assert its.doubt(MADE_NS + 9 * YEAR_NS)
    assert its.memory.good_ns == SOON_NS
    assert its.doubt(SOON_NS + DAY_NS) == ""


def test_the_operator_may_know_better():
    later_ns = MADE_NS + 9 * YEAR_NS
    its = judge(good_ns=SOON_NS)
    assert its.doubt(later_ns)
    its.confirm(later_ns)
    assert its.doubt(later_ns + DAY_NS) == ""
    again = UtcJudge(its.memory, lambda: False)  # after a restart
    assert again.doubt(later_ns + 2 * DAY_NS) == ""
    assert again.doubt(40 * 10**9)


@given(st.integers(MADE_NS, LATEST_NS), st.lists(st.integers(0, 30 * DAY_NS)))
def test_a_clock_that_runs_on_stays_believed(utc_ns, steps_ns):
    its = judge(good_ns=utc_ns)
    for step_ns in [0, *steps_ns]:
        utc_ns += step_ns
        assert (its.doubt(utc_ns) == "") == (utc_ns <= LATEST_NS)


def test_times_of_any_year_can_be_printed():
    assert as_text(0) == "1970-01-01 00:00 UTC"
    assert "after 1970" in as_text(2**80)


def test_the_kernel_can_be_asked():
    assert is_synchronised() in {True, False}


@pytest.mark.parametrize("utc_ns", [40 * 10**9, MADE_NS + 9 * YEAR_NS])
def test_an_impossible_time_is_not_confirmed_with_the_arm(utc_ns):
    assert judge().unverified(utc_ns) == ""


def test_who_confirms_the_arm_confirms_its_time_once(tmp_path):
    clock = SetClock()
    clock.offset_ns = SOON_NS - clock.now_ns
    its, judged = watch(tmp_path, clock)
    its.check()
    assert "nobody has confirmed it" in judged[0][0] or is_synchronised()
    assert ("2026-12-01" in its.confirm_unverified()) != is_synchronised()
    assert its.confirm_unverified() == ""
    its.close()
    assert judged[-1] == ("", "")
    its, judged = watch(tmp_path, clock)
    its.check()
    its.close()
    assert judged == [("", "")]


def watch(tmp_path, clock):
    judged = []
    return UtcWatch(clock, tmp_path / "utc.json", lambda *said: judged.append(said)), (
        judged
    )


def test_changes_are_reported_once_and_outlive_a_restart(tmp_path):
    clock = SetClock()
    clock.offset_ns = SOON_NS - clock.now_ns
    its, judged = watch(tmp_path, clock)
    its.confirm()
    its.check()
    clock.offset_ns -= 9 * YEAR_NS
    clock.now_ns += LOOK_NS
    its.check()
    clock.now_ns += LOOK_NS
    its.check()
    its.close()
    assert [bool(doubt) for doubt, _ in judged] == [False, True]
    assert "traverse confirm --utc" in judged[1][1]
    assert json.loads((tmp_path / "utc.json").read_text())["good_ns"] == SOON_NS
    clock.offset_ns = SOON_NS - DAY_NS - clock.now_ns
    its, judged = watch(tmp_path, clock)
    its.check()
    assert "has shown" in judged[0][0]
    its.confirm()
    its.close()
    assert [bool(doubt) for doubt, _ in judged] == [True, False]
    its, judged = watch(tmp_path, clock)
    its.check()
    its.close()
    assert judged == [("", "")]


class AwakeClock(SetClock):
    """A clock that may be suspended, or set."""

    slept_ns = 0

    def elapsed_ns(self):
        return self.now_ns + self.slept_ns

    def pass_by(self, *, set_by_ns=0, slept_ns=0):
        self.now_ns += LOOK_NS
        self.slept_ns += slept_ns
        self.offset_ns += set_by_ns + slept_ns


HOUR_NS = 3600 * 10**9


def test_a_clock_that_nothing_keeps_and_that_is_set_by_an_hour_is_confirmed(tmp_path):
    clock = AwakeClock()
    clock.offset_ns = SOON_NS - clock.now_ns
    its, judged = watch(tmp_path, clock)
    its.confirm()
    for change in (
        {"slept_ns": 9 * HOUR_NS},
        {"set_by_ns": 20 * 10**9},  # by hand now and then
        {"set_by_ns": HOUR_NS},
        {},
    ):
        clock.pass_by(**change)
        its.check()
    its.close()
    assert [bool(doubt) for doubt, _ in judged] == [False, True]
    assert "set by +3600 s, and no program keeps it" in judged[1][0]
    its, judged = watch(tmp_path, clock)  # after a restart, too
    its.check()
    clock.pass_by()
    its.check()
    clock.pass_by(set_by_ns=-HOUR_NS)  # back again
    its.check()
    its.close()
    assert [bool(doubt) for doubt, _ in judged] == [True, False]


def test_a_time_that_was_set_is_believed_once_it_is_kept_or_confirmed():
    for synchronised in (True, False):
        its = judge(good_ns=SOON_NS, synchronised=False)
        its.note_elapsed(SOON_NS, 0)
        its.note_elapsed(SOON_NS + HOUR_NS, 10**9)
        assert its.doubt(SOON_NS + HOUR_NS)
        if synchronised:
            its = UtcJudge(its.memory, lambda: True)
        else:
            its.confirm(SOON_NS + HOUR_NS)
        assert its.doubt(SOON_NS + HOUR_NS) == ""
        assert its.memory.set_by_ns == 0


@pytest.mark.parametrize("content", ["", "[]", '{"good_ns": "x"}', "{"])
def test_a_file_that_makes_no_sense_is_begun_anew(tmp_path, content):
    (tmp_path / "utc.json").write_text(content)
    file = UtcFile(tmp_path / "utc.json")
    assert file.memory == UtcMemory()
    file.close()
