"""Commands that come too late, by a clock that a test sets."""

import pytest

from tests.daemon.commands.test_dispatcher import Bench, SteppedClock
from traverse.daemon.commands.expiry import EXPIRED, CommandExpiry
from traverse.daemon.errors import RequestRefusedError
from traverse.daemon.mqtt.subscriber import IncomingCommand
from traverse.protocol.encoding import encode
from traverse.protocol.messages import Clock, Command, Expiry, PointArgs

SECOND_NS = 1_000_000_000


class Link:
    """A connection to a broker that keeps the order, and the clock that runs on it."""

    def __init__(self) -> None:
        self.clock = SteppedClock()
        self.expiry = CommandExpiry("bench-7", self.clock)
        self.subscribed_ns = self.clock.elapsed_ns()

    def incoming(self, payload=b"", *, retained=False, expiry_s=None):
        return IncomingCommand(
            "any", payload, retained, None, None, self.subscribed_ns, expiry_s
        )

    def beat(self) -> bytes:
        return encode(self.expiry.message(), "msgpack")

    def return_clock(self, payload: bytes | None = None, **options) -> None:
        beat = self.beat() if payload is None else payload
        self.expiry.receive(self.incoming(beat, **options))

    def beat_for_s(self, seconds: int) -> None:
        for _ in range(2 * seconds):
            self.clock.go_on_s(0.5)
            self.return_clock()

    def expires_in_s(self, seconds: float) -> Expiry:
        shown = self.expiry.message()
        at_ns = shown.now_ns + round(seconds * SECOND_NS)
        return Expiry(clock=shown.clock, at_ns=at_ns)

    def refusal(self, expires=None, **options) -> str | None:
        arrival = self.expiry.arrival(self.incoming(**options))
        try:
            self.expiry.check(expires, arrival)
        except RequestRefusedError as error:
            return f"{error.code}: {error}; {error.remedy}"
        return None


def test_a_command_without_expiry_is_executed_within_five_seconds():
    link = Link()
    link.beat_for_s(60)
    arrival = link.expiry.arrival(link.incoming())
    link.clock.go_on_s(4.9)
    link.expiry.check(None, arrival)
    link.clock.go_on_s(0.2)
    with pytest.raises(RequestRefusedError, match=r"may have waited 5\.1 s .* 5 s"):
        link.expiry.check(None, arrival)


def test_what_lay_unread_while_the_daemon_was_stopped_is_refused():
    link = Link()
    link.beat_for_s(10)
    returned_before = link.beat()
    link.clock.go_on_s(18.0)
    link.return_clock(returned_before)  # it lay before the commands
    assert link.refusal().startswith(f"{EXPIRED}: ")
    assert "waited 18.0 s" in link.refusal()
    link.return_clock()
    assert "stood still for 18.0 s" in link.refusal()  # may have lain at the broker
    assert link.refusal(link.expires_in_s(3.0)) is None
    link.beat_for_s(2)
    assert link.refusal() is None


def test_a_new_connection_brings_nothing_from_before_it():
    link = Link()
    link.beat_for_s(10)
    link.clock.go_on_s(60.0)
    link.subscribed_ns = link.clock.elapsed_ns()
    assert link.refusal() is None
    link.return_clock()
    assert "stood still for 60.0 s" in link.refusal()  # a client may have waited, too
    link.beat_for_s(2)
    assert link.refusal() is None


def test_a_stated_instant_counts_however_the_command_came():
    link = Link()
    link.return_clock()
    expires = link.expires_in_s(20.0)
    link.clock.go_on_s(19.9)
    assert link.refusal(expires) is None
    link.clock.go_on_s(0.3)
    assert "0.2 s after the instant until which" in link.refusal(expires)


def test_an_instant_by_the_clock_of_an_earlier_run_is_refused():
    link, earlier = Link(), Link()
    link.return_clock()
    assert "earlier run of this daemon" in link.refusal(earlier.expires_in_s(1e6))


def test_the_expiry_interval_of_mqtt_5_replaces_the_five_seconds():
    link = Link()
    link.return_clock()
    link.clock.go_on_s(1.5)
    assert link.refusal(expiry_s=2) is None
    assert "was valid for 1 s" in link.refusal(expiry_s=1)
    link.clock.go_on_s(60)
    assert link.refusal(expiry_s=120) is None


@pytest.mark.parametrize("kind", ["retained", "of another run", "future", "garbage"])
def test_only_its_own_clock_tells_the_daemon_that_the_line_moves(kind):
    link = Link()
    link.return_clock()
    link.clock.go_on_s(6.0)
    now = link.expiry.message()
    match kind:
        case "retained":
            link.return_clock(retained=True)
        case "of another run":
            link.return_clock(encode(now.model_copy(update={"clock": "x"}), "json"))
        case "future":
            later = Clock(arm="bench-7", clock=now.clock, now_ns=now.now_ns + 1)
            link.return_clock(encode(later, "json"))
        case _:
            link.return_clock(b"\xc1")
    assert "waited 6.0 s" in link.refusal()


def test_a_broker_that_withholds_the_clock_is_named_with_its_remedy():
    link = Link()
    assert link.refusal() is None
    link.clock.go_on_s(5.5)
    refusal = link.refusal()
    assert "does not return this daemon's messages on traverse/bench-7/clock" in refusal
    assert "access list" in refusal


async def test_a_late_repetition_gets_the_first_answer_and_a_late_request_none():
    bench = Bench()
    subscribed_ns = bench.clock.elapsed_ns()
    first = encode(Command.carrying(PointArgs(), "r-1"), "json")
    second = encode(Command.carrying(PointArgs(), "r-2"), "json")
    bench.send(first, subscribed_ns=subscribed_ns)
    await bench.replies(1)
    bench.clock.go_on_s(20.0)
    bench.send(first, subscribed_ns=subscribed_ns)
    bench.send(second, subscribed_ns=subscribed_ns)
    replies = await bench.replies(3)
    assert [reply.ok for reply in replies] == [True, True, False]
    assert replies[2].error.code == EXPIRED
    assert len(bench.carried_out) == 1
    await bench.desk.close()
