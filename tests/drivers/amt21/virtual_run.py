import math
from collections.abc import Callable

from benchmarks.tools.virtual_time import Cable, Straight, VirtualTime, played
from tests.drivers.amt21.fake_encoders import FakeEncoder, FakeLine, VirtualEncoders
from tests.drivers.delivered import Delivered
from traverse.drivers.amt21.driver import Amt21Driver, Amt21Options
from traverse.drivers.base.values import DeviceAlarm
from traverse.drivers.io.ports import PortAccess

ADDRESSES = (0x54, 0x58, 0x5C)


class Played(Delivered):
    def __init__(
        self,
        line: FakeLine,
        seconds: float = 1.0,
        rate_hz: float = 100.0,
        at: dict[float, Callable[["Played"], object]] | None = None,
        **options,
    ) -> None:
        self.time = VirtualTime(seconds)
        self.cable = Cable(self.time)
        self.line = line
        self.peer = VirtualEncoders(line, self.cable)
        self.time.devices = [self.peer, self]
        self._at = sorted((at or {}).items())
        straight = Straight(self.time.over)
        self.driver = Amt21Driver(
            "arm",
            Amt21Options(port="somewhere", addresses=tuple(line.encoders), **options),
            straight,
            monotonic_ns=self.time.monotonic_ns,
            ports=PortAccess(self.cable.open_port, self.time.wait_for_any),
        )
        self.driver.request_stream(rate_hz)
        played(self.driver, self.time.over)
        self.all = straight.all

    def live(self, now_s: float) -> None:
        while self._at and self._at[0][0] <= now_s:
            self._at.pop(0)[1](self)

    def next_due_s(self, block_s: float) -> float:
        return self._at[0][0] if self._at else math.inf

    def alarms(self) -> list[tuple[int | None, bool]]:
        return [(alarm.channel, alarm.raised) for alarm in self.of(DeviceAlarm)]


def line(n: int = 3, *, echo: bool = False, **encoder) -> FakeLine:
    made = FakeLine(*ADDRESSES[:n], echo=echo)
    for number, address in enumerate(made.encoders):
        made.encoders[address] = FakeEncoder(count=1000 * (number + 1), **encoder)
    return made
