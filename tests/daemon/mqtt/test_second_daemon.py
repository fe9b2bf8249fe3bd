"""A status of a foreign session reveals another daemon of this arm."""

import random

import pytest

from tests.daemon.values import SetClock
from tests.protocol.message_examples import STATUS
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.mqtt.second_daemon import (
    AWAY_S,
    CODE,
    LAST_RESTORE_S,
    OVERWRITTEN,
    UNREAD,
    SecondDaemonWatch,
)
from traverse.protocol.encoding import encode


class Rig:
    """A watch of an arm whose own session is `m`."""

    def __init__(self) -> None:
        self.clock, self.events = SetClock(), []
        log = EventLog(self.clock, self.events.append)
        self.restored = []
        self.watch = SecondDaemonWatch(
            STATUS.arm, "msgpack", self.clock, log, lambda: self.restored.append(True)
        )
        self.own = self.watch.sending(self.status("m"))

    def status(self, session):
        return STATUS.model_copy(update={"session": session})

    def hear(self, session, *, retained=False):
        payload = encode(self.status(session), "msgpack")
        self.watch.receive(payload, retained=retained)

    def active(self):
        return [event.active for event in self.events if event.code == CODE]


def test_what_was_retained_before_is_of_the_past():
    rig = Rig()
    for _ in range(3):
        rig.hear("a", retained=True)
    assert rig.active() == []
    rig.hear("m")
    assert rig.watch.retry_s == 0.0


def test_a_restarted_broker_may_once_have_an_old_status():
    rig = Rig()
    rig.hear("m")
    rig.hear("a", retained=True)
    assert rig.active() == []
    rig.hear("a", retained=True)
    assert rig.active() == [True]


def test_own_sessions_are_no_others():
    rig = Rig()
    rig.watch.sending(rig.status("n"))
    rig.hear("n")
    rig.hear("m")
    rig.watch.receive(b"no status", retained=False)
    assert rig.active() == []


@pytest.mark.parametrize("is_heard", [True, False])
def test_a_status_that_cannot_be_read_is_reported_once(is_heard):
    rig = Rig()
    for _ in range(2):
        rig.watch.connected(True)
        if is_heard:
            rig.hear("m")
        for _ in range(3):
            rig.clock.now_ns += 6 * 10**9
            rig.watch.poll()
        rig.watch.connected(False)
    assert [event.code for event in rig.events] == ([] if is_heard else [UNREAD])


@pytest.mark.parametrize(("other", "away_s"), [("a", AWAY_S), ("z", 0.0)])
def test_one_of_the_two_gives_way_until_the_other_is_gone(other, away_s):
    rig = Rig()
    rig.hear("m")
    rig.hear(other)
    assert rig.active() == [True]
    assert other in rig.events[0].text
    assert rig.watch.retry_s == away_s
    rig.clock.now_ns += 149 * 10**9
    rig.watch.poll()
    assert rig.active() == [True]
    rig.clock.now_ns += 2 * 10**9
    rig.watch.poll()
    assert rig.active() == [True, False]
    assert rig.watch.retry_s == 0.0


def test_a_status_that_was_cleared_or_overwritten_is_published_again():
    rig = Rig()
    rig.hear("m")
    rig.watch.poll()
    assert not rig.restored
    late_will = encode(rig.status("m").model_copy(update={"online": False}), "msgpack")
    for n, payload in enumerate((b"", late_will, b"{}"), start=1):
        rig.watch.receive(payload, retained=False)
        rig.watch.poll()
        rig.watch.poll()
        assert len(rig.restored) == n
        rig.clock.now_ns += int(LAST_RESTORE_S * 1e9)
    assert rig.active() == []


def test_who_overwrites_it_for_ever_is_answered_more_and_more_seldom(monkeypatch):
    monkeypatch.setattr(random, "uniform", lambda _, longest: longest)  # no jitter
    rig = Rig()

    def minutes(n, *, overwritten):
        for _ in range(n * 60):
            if overwritten:
                rig.watch.receive(b"", retained=False)
            rig.watch.poll()
            rig.clock.now_ns += 10**9
        return len(rig.restored)

    first = minutes(1, overwritten=True)
    assert first == 6  # at 0, 1, 3, 7, 15, 31 s
    assert minutes(10, overwritten=True) == first + 10
    assert minutes(4, overwritten=False) == first + 11
    changes = [event.active for event in rig.events if event.code == OVERWRITTEN]
    assert changes == [True, False]
    assert minutes(1, overwritten=True) == first + 11 + first


def test_the_will_of_an_earlier_daemon_is_no_second_daemon():
    rig = Rig()
    will = encode(rig.status("a").model_copy(update={"online": False}), "msgpack")
    rig.watch.receive(will, retained=False)
    rig.watch.poll()
    assert rig.active() == []
    assert rig.restored
