"""GPIO lines as far as they go without a chip: gpiod's own values, a pipe to wait for.

No GPIO chip is needed, and none was there when this was written.
"""

import asyncio
import errno
import os
import threading
import time

import pytest
from pydantic import ValidationError

pytest.importorskip("gpiod", reason="the extra gpio is not installed")

import gpiod
from gpiod.line import Bias, Clock, Direction, Edge, Value

from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.values import (
    DeviceFault,
    DeviceLost,
    DeviceUp,
    LatchedCounts,
)
from traverse.drivers.triggers.gpio import GpioDriver, GpioOptions
from traverse.testing.deliveries import Deliveries
from traverse.testing.driver_contract import DriverContract, EdgeContract, up

RISING, FALLING = gpiod.EdgeEvent.Type.RISING_EDGE, gpiod.EdgeEvent.Type.FALLING_EDGE
OFFSETS = {17: 17, "probe": 27}


class Chip:
    """The kernel's side: hands out lines, and events in gpiod's own type."""

    def __init__(self) -> None:
        self.error: OSError | None = None
        self.requested: list[tuple] = []
        self.values = [Value.INACTIVE, Value.INACTIVE]
        self._lock = threading.Lock()
        self._events: list[gpiod.EdgeEvent] = []
        self._seq = {17: 0, 27: 0}
        self._write = -1

    def request(self, path, config, consumer, event_buffer_size):
        if self.error is not None:
            raise self.error
        self.requested.append((path, config, consumer, event_buffer_size))
        self._events = []
        self._seq = {17: 0, 27: 0}
        self.fd, self._write = os.pipe()
        self.offsets = [OFFSETS[line] for line in config]
        return self

    def get_values(self):
        return self.values

    def edge(self, offset, kind, time_ns=None, *, dropped=0):
        with self._lock:
            self._seq[offset] += 1 + dropped
            seq = self._seq[offset]
            now_ns = time.monotonic_ns() if time_ns is None else time_ns
            self._events.append(gpiod.EdgeEvent(kind, now_ns, offset, seq, seq))
            os.write(self._write, b"!")

    def read_edge_events(self):
        if self.error is not None:
            raise self.error
        with self._lock:
            os.read(self.fd, 4096)
            events, self._events = self._events, []
            return events

    def vanish(self):
        self.error = OSError(errno.ENODEV, "No such device")
        if self._write >= 0:
            os.write(self._write, b"!")

    def release(self):
        os.close(self.fd)
        os.close(self._write)
        self._write = -1


class GpioRig:
    def __init__(self, **options) -> None:
        self.chip = Chip()
        self.port = "/dev/gpiochip9"
        self.delivery_queue = DeliveryQueue(asyncio.get_running_loop())
        self.driver = GpioDriver(
            "inputs",
            GpioOptions(
                port=self.port, lines=(17, "probe"), **{"debounce_us": 0} | options
            ),
            self.delivery_queue,
            request=self.chip.request,
        )
        self._level = False

    def press(self):
        self._level = not self._level
        self.chip.edge(17, RISING if self._level else FALLING)

    def unplug(self):
        self.chip.vanish()

    def plug(self):
        self.chip.error = None


@pytest.fixture
async def rig():
    rig = GpioRig()
    yield rig
    rig.driver.close()


class TestContract(DriverContract, EdgeContract):
    pass


async def test_it_says_which_inputs_are_active_when_it_is_opened(rig):
    rig.chip.values = [Value.INACTIVE, Value.ACTIVE]
    with rig.driver:
        deliveries = await up(rig)
    assert deliveries.of(DeviceUp)[0].active_inputs == 0b10


async def test_lines_are_requested_with_every_change_stamped_by_the_kernel(rig):
    with rig.driver:
        await up(rig)
    ((path, settings, consumer, buffer_events),) = rig.chip.requested
    assert path == "/dev/gpiochip9"
    assert list(settings) == [17, "probe"]
    assert consumer == "traverse"
    assert buffer_events >= 64
    for line in settings.values():
        assert isinstance(line, gpiod.LineSettings)
        assert line.direction is Direction.INPUT
        assert line.edge_detection is Edge.BOTH
        assert line.event_clock is Clock.MONOTONIC
        assert line.bias is Bias.PULL_UP
        assert line.active_low is True
        assert line.debounce_period.total_seconds() == 0.0  # it would shift the stamps


async def test_edges_carry_the_time_of_the_first_change(tmp_path):
    rig = GpioRig(debounce_us=200_000)  # longer than the test takes to bounce
    with rig.driver:
        deliveries = await up(rig)
        at_ns = time.monotonic_ns()
        for kind, later_us in ((RISING, 0), (FALLING, 200), (RISING, 500)):
            rig.chip.edge(27, kind, at_ns + later_us * 1000)
        await deliveries.until(lambda: deliveries.of(LatchedCounts), "the edge")
    (edge,) = deliveries.of(LatchedCounts)
    assert (edge.input, edge.active, edge.sample_time_ns) == (1, True, at_ns)
    assert edge.counts == ()


async def test_an_input_that_is_active_at_the_start_is_no_edge(rig):
    rig.chip.values = [Value.ACTIVE, Value.INACTIVE]
    with rig.driver:
        deliveries = await up(rig)
        rig.chip.edge(17, FALLING)
        await deliveries.until(lambda: deliveries.of(LatchedCounts), "the release")
    (edge,) = deliveries.of(LatchedCounts)
    assert (edge.input, edge.active) == (0, False)


async def test_events_that_the_kernel_dropped_are_reported(rig):
    with rig.driver:
        deliveries = await up(rig)
        rig.chip.edge(17, RISING)
        rig.chip.edge(17, RISING, dropped=4)
        await deliveries.until(lambda: deliveries.of(DeviceFault), "the loss")
    (fault,) = deliveries.of(DeviceFault)
    assert (fault.code, fault.count) == ("edges_lost", 4)


@pytest.mark.parametrize(
    ("number", "remedy"),
    [
        (errno.ENOENT, "gpiodetect"),
        (errno.EACCES, "group gpio"),
        (errno.EBUSY, "gpioinfo"),
        (errno.EINVAL, "as-is"),
    ],
)
async def test_a_chip_that_does_not_give_its_lines_is_reported_with_what_to_do(
    rig, number, remedy
):
    rig.chip.error = OSError(number, os.strerror(number))
    with rig.driver:
        deliveries = Deliveries(rig.delivery_queue)
        await deliveries.until(lambda: deliveries.of(DeviceLost), "the loss")
    (lost,) = deliveries.of(DeviceLost)
    assert "/dev/gpiochip9" in lost.reason
    assert remedy in lost.remedy


async def test_a_chip_that_is_not_there_is_reported_by_the_library_itself(tmp_path):
    delivery_queue = DeliveryQueue(asyncio.get_running_loop())
    path = str(tmp_path / "gpiochip0")
    with GpioDriver("inputs", GpioOptions(port=path, lines=(1,)), delivery_queue):
        deliveries = Deliveries(delivery_queue)
        await deliveries.until(lambda: deliveries.of(DeviceLost), "the loss")
    assert path in deliveries.of(DeviceLost)[0].reason


@pytest.mark.parametrize("lines", [(), (-1,), ("",), (3, 3), tuple(range(9)), (True,)])
def test_impossible_lines_are_refused(lines):
    with pytest.raises(ValidationError):
        GpioOptions(port="/dev/gpiochip0", lines=lines)


def test_lines_are_offsets_or_names():
    options = GpioOptions(port="/dev/gpiochip0", lines=(0, 1, "probe"))
    assert options.where == "/dev/gpiochip0"
