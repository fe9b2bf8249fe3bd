import asyncio
import errno
import os
import re
import stat
import struct
import time
from pathlib import Path

import pytest
from pydantic import ValidationError

from traverse.drivers.base.delivery_queue import DeliveryQueue
from traverse.drivers.base.values import DeviceFault, DeviceUp, LatchedCounts
from traverse.drivers.triggers.evdev import (
    EVIOCGKEY,
    EVIOCGRAB,
    EVIOCSCLOCKID,
    KEY_CODES,
    EvdevDriver,
    EvdevOptions,
)
from traverse.testing.deliveries import Deliveries
from traverse.testing.driver_contract import DriverContract, EdgeContract, up

HEADER = Path("/usr/include/linux/input-event-codes.h")
KEY_B, KEY_C, KEY_A = 48, 46, 30


def event(time_ns, kind, code, value):
    seconds, rest_ns = divmod(time_ns, 10**9)
    return struct.pack("@llHHi", seconds, rest_ns // 1000, kind, code, value)


class Kernel:
    def __init__(self, *, stamps=True, grabs=True) -> None:
        self.asked: list[tuple[int, object]] = []
        self.down: set[int] = set()
        self._refused = {EVIOCSCLOCKID} if not stamps else set()
        self._refused |= {EVIOCGRAB} if not grabs else set()

    def __call__(self, fd, request, argument):
        self.asked.append((request, argument))
        assert stat.S_ISFIFO(os.fstat(fd).st_mode)
        if request in self._refused:
            raise OSError(errno.ENOTTY, "no such request")
        if request == EVIOCGKEY:
            bits = bytearray(len(argument))
            for code in self.down:
                bits[code // 8] |= 1 << code % 8
            return bytes(bits)
        return 0


class PedalRig:
    """A named pipe replaces the device file."""

    def __init__(self, path: Path, kernel: Kernel | None = None, **options) -> None:
        self.path, self.port = path, str(path)
        self.kernel = kernel or Kernel()
        self.delivery_queue = DeliveryQueue(asyncio.get_running_loop())
        self.driver = EvdevDriver(
            "pedal",
            EvdevOptions(port=self.port, keys=("KEY_B", "KEY_C"), **options),
            self.delivery_queue,
            ask_kernel=self.kernel,
        )
        self._level = False
        self.plug()

    def plug(self):
        os.mkfifo(self.path)
        self.writer = os.open(self.path, os.O_RDWR)

    def unplug(self):
        if self.path.exists():
            self.path.unlink()
            os.close(self.writer)

    def write(self, *events):
        os.write(self.writer, b"".join(events))

    def key(self, code, value, time_ns=None):
        now_ns = time.monotonic_ns() if time_ns is None else time_ns
        self.write(event(now_ns, 1, code, value), event(now_ns, 0, 0, 0))

    def press(self):
        self._level = not self._level
        self.key(KEY_B, int(self._level))


@pytest.fixture
async def rig(tmp_path):
    rig = PedalRig(tmp_path / "pedal")
    yield rig
    rig.driver.close()
    rig.unplug()


class TestContract(DriverContract, EdgeContract):
    pass


async def edges(rig, n) -> list[LatchedCounts]:
    deliveries = await up(rig)
    await deliveries.until(lambda: len(deliveries.of(LatchedCounts)) >= n, f"{n} edges")
    return deliveries.of(LatchedCounts)


async def test_keys_are_inputs_at_the_kernels_time(rig):
    at_ns = time.monotonic_ns() // 1000 * 1000
    rig.key(KEY_C, 1, at_ns - 3_000_000)
    rig.key(KEY_C, 2, at_ns - 2_000_000)  # it repeats while it is held
    rig.key(KEY_A, 1, at_ns - 1_500_000)  # this one was not requested
    rig.write(event(at_ns - 1_400_000, 4, 4, 0x70005), event(at_ns, 2, 0, 7))
    rig.key(KEY_C, 0, at_ns - 1_000_000)
    rig.key(KEY_B, 1, at_ns)
    with rig.driver:
        taken_edges = await edges(rig, 3)
    assert [(edge.input, edge.active) for edge in taken_edges] == [
        (1, True),
        (1, False),
        (0, True),
    ]
    times_ns = [edge.sample_time_ns for edge in taken_edges]
    assert times_ns == [at_ns - 3_000_000, at_ns - 1_000_000, at_ns]
    assert {(edge.counts, edge.status) for edge in taken_edges} == {((), ())}


async def test_the_kernel_is_set_to_the_monotonic_clock_and_the_keys_alone(rig):
    with rig.driver:
        await up(rig)
    ioctls = dict(rig.kernel.asked)
    assert ioctls[EVIOCSCLOCKID] == struct.pack("i", time.CLOCK_MONOTONIC)
    assert ioctls[EVIOCGRAB] == 1
    assert EVIOCSCLOCKID == 0x400445A0
    assert EVIOCGRAB == 0x40044590
    assert EVIOCGKEY == 0x80604518  # 96 bytes


async def test_who_shares_the_device_does_not_grab_it(tmp_path):
    rig = PedalRig(tmp_path / "pedal", exclusive=False)
    with rig.driver:
        await up(rig)
    assert EVIOCGRAB not in dict(rig.kernel.asked)
    rig.unplug()


async def test_a_device_that_cannot_be_grabbed_is_read_all_the_same(tmp_path):
    rig = PedalRig(tmp_path / "pedal", Kernel(grabs=False))
    rig.key(KEY_B, 1)
    with rig.driver:
        assert len(await edges(rig, 1)) == 1
    rig.unplug()


async def test_what_stamps_with_another_clock_is_reported_and_stamped_when_it_is_read(
    tmp_path,
):
    rig = PedalRig(tmp_path / "pedal", Kernel(stamps=False))
    begun_ns = time.monotonic_ns()
    rig.key(KEY_B, 1, time_ns=1_700_000_000 * 10**9)
    with rig.driver:
        deliveries = await up(rig)
        await deliveries.until(lambda: deliveries.of(LatchedCounts), "the edge")
    (edge,) = deliveries.of(LatchedCounts)
    assert begun_ns <= edge.sample_time_ns <= time.monotonic_ns()
    assert [fault.code for fault in deliveries.of(DeviceFault)] == ["times_estimated"]
    rig.unplug()


async def test_a_key_that_is_down_at_the_start_is_no_edge(rig):
    rig.kernel.down = {KEY_B}
    rig.key(KEY_B, 0)
    with rig.driver:
        (edge,) = await edges(rig, 1)
    assert (edge.input, edge.active) == (0, False)


async def test_after_an_overrun_the_keys_are_looked_at_and_the_loss_is_reported(rig):
    with rig.driver:
        deliveries = await up(rig)
        rig.kernel.down = {KEY_C}
        now_ns = time.monotonic_ns()
        dropped = [event(now_ns, 0, 3, 0), event(now_ns, 1, KEY_B, 1)]
        rig.write(*dropped, event(now_ns, 0, 0, 0))
        await deliveries.until(
            lambda: deliveries.of(LatchedCounts), "the key that is down"
        )
    (edge,) = deliveries.of(LatchedCounts)
    assert (edge.input, edge.active) == (1, True)
    (fault,) = deliveries.of(DeviceFault)
    assert fault.code == "edges_lost"


async def test_edges_that_find_no_room_come_later_and_once(tmp_path):
    rig = PedalRig(tmp_path / "pedal")
    delivery_queue = DeliveryQueue(asyncio.get_running_loop(), max_others=2)
    driver = EvdevDriver(
        "pedal",
        EvdevOptions(port=rig.port, keys=("KEY_B",)),
        delivery_queue,
        ask_kernel=rig.kernel,
    )
    with driver:
        deliveries = Deliveries(delivery_queue)
        await deliveries.until(lambda: deliveries.of(DeviceUp), "the device")
        for number in range(40):
            rig.key(KEY_B, 1 - number % 2)
        await deliveries.until(
            lambda: len(deliveries.of(LatchedCounts)) >= 40, "40 edges"
        )
    assert [e.token for e in deliveries.of(LatchedCounts)] == list(range(1, 41))
    rig.unplug()


@pytest.mark.skipif(not HEADER.exists(), reason="the kernel's header is not installed")
def test_names_and_numbers_are_those_of_the_kernels_header():
    defined = re.findall(
        r"^#define\s+((?:KEY|BTN)_\w+)\s+(0x\w+|\d+)\b", HEADER.read_text(), re.M
    )
    kernels = {name: int(number, 0) for name, number in defined}
    assert {name: kernels[name] for name in KEY_CODES} == KEY_CODES


@pytest.mark.parametrize(
    "keys",
    [(), ("KEY_NONE",), (0,), (768,), ("KEY_B", 48), ("b",), tuple(range(1, 10))],
)
def test_impossible_keys_are_refused(keys):
    with pytest.raises(ValidationError):
        EvdevOptions(port="p", keys=keys)
