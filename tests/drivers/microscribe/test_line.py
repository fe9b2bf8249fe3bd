from typing import Any

import pytest

from traverse.drivers.microscribe.line import PACKET_S, MicroscribeLine, TimedPacket
from traverse.drivers.microscribe.packets import PacketClock
from traverse.protocol.microscribe.packets import Framing, PacketDecoder

MS = 1_000_000
PERIOD_MS = 10
COMMAND = 0xA3  # answers a request of timer and encoders


class LateArm:
    """An arm behind a port that delays bytes either way; encoder 0 numbers requests.

    Attributes:
        delay_ns: of each direction.
        latched_ns: when each request was carried out.
    """

    def __init__(self) -> None:
        self.now_ns, self.delay_ns = 0, MS // 5
        self.latched_ns: list[int] = []
        self._answers: list[tuple[int, bytes]] = []

    def wait(self, seconds: float) -> bool:
        until_ns = self.now_ns + round(seconds * 1e9)
        due_ns = self._answers[0][0] if self._answers else until_ns + 1
        self.now_ns = max(self.now_ns, min(due_ns, until_ns))
        return due_ns <= self.now_ns

    def read(self) -> bytes:
        self.now_ns += 1
        return self._answers.pop(0)[1]

    def write(self, data: bytes) -> None:
        at_ns = self.now_ns + self.delay_ns
        ticks, number = at_ns // MS, len(self.latched_ns)
        self.latched_ns.append(at_ns)
        words = (ticks, number, 0, 0, 0, 0, 0)
        body = bytes(part for w in words for part in (w >> 7 & 127, w & 127))
        answer = bytes([COMMAND, 0]) + body
        self._answers.append((at_ns + self.delay_ns, answer))

    def close(self) -> None:
        """Nothing is open."""


@pytest.fixture
def arm() -> LateArm:
    return LateArm()


@pytest.fixture
def line(arm: Any) -> MicroscribeLine:
    line = MicroscribeLine(arm, 115200, lambda: arm.now_ns, lambda: False)
    line.patience_s = line.usual_patience_s = 0.02
    return line


@pytest.mark.parametrize("delay_ms", [3, 8, 12, 23])
@pytest.mark.parametrize("timer_rate_hz", [0.0, 1000.0])
def test_the_time_of_an_answer_that_comes_late_has_an_honest_bound(
    arm, line, delay_ms, timer_rate_hz
):
    clock = PacketClock(timer_rate_hz, 16384, 2 * arm.delay_ns)
    decoder = PacketDecoder(Framing.HCI2, timer=True)
    last: TimedPacket | None = None
    for request in range(300):
        arm.now_ns = max(arm.now_ns, PERIOD_MS * MS * request)
        if request == 150:
            arm.delay_ns = delay_ms * MS
        heard = line.packet(decoder, clock.is_old)
        if heard is None:
            continue
        latched_ns = arm.latched_ns[heard.packet.encoders[0]]
        assert heard.sent_ns <= latched_ns <= heard.begun_ns
        _, time_ns = clock.time_of(heard)
        assert abs(time_ns - latched_ns) <= clock.bound_ns
        last = heard
    assert last is not None
    # Later requests wait for their answers.
    assert arm.latched_ns[last.packet.encoders[0]] > 2800 * MS
    assert 0.02 <= line.patience_s <= PACKET_S
