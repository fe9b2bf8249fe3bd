"""`CanBus` on the kernel's own interface: stamps, filters, losses, periodic frames."""

import time

import can
import numpy as np

from tests.vm import can_interface
from tests.vm.can_interface import NAME, open_raw, send
from tests.vm.table import Table
from traverse.drivers.base.values import DeviceError
from traverse.drivers.io.can_bus import FRAMES_LOST, CanBus, Frame
from traverse.protocol.canopen.frames import SYNC, identifiers

NODES = (11, 12, 13, 14, 15, 16, 17)
N_FRAMES = 300
FLOOD = 20_000
SYNC_HZ, SYNC_S = 100.0, 3.0


def opened() -> CanBus:
    return CanBus("socketcan", NAME, 1_000_000, identifiers=identifiers(NODES))


def drained(bus: CanBus) -> list[Frame]:
    frames: list[Frame] = []
    while some := bus.receive(0.05):
        frames += [frame for frame in some if frame[0] != FRAMES_LOST]
    return frames


def stamps() -> str:
    """Frames that waited have the instants at which they were sent."""
    bus, port = opened(), open_raw()
    sent_ns = []
    for _ in range(50):
        before_ns = time.monotonic_ns()
        send(port, SYNC, b"")
        sent_ns.append((before_ns, time.monotonic_ns()))
    time.sleep(0.2)
    frames = drained(bus)
    bus.close()
    port.close()
    assert len(frames) == len(sent_ns), f"{len(frames)} of {len(sent_ns)} came"
    out_us = [
        max(before - stamp_ns, stamp_ns - after, 0) * 1e-3
        for (before, after), (_, _, stamp_ns) in zip(sent_ns, frames, strict=True)
    ]
    width_us = np.median([(after - before) * 1e-3 for before, after in sent_ns])
    assert max(out_us) < 2000, f"{max(out_us):.0f} us beside the sending"
    return (
        f"read 200 ms later, at most {max(out_us):.0f} us beside "
        f"the call that sent it ({width_us:.0f} us)"
    )


def filters() -> str:
    """The kernel compares identifiers for us, by its table and not one by one."""
    bus, port = opened(), open_raw()
    received = can_interface.exact_receivers()
    for can_id in (0x7A0, 0x18B | 0x8000_0000, 0x18B | 0x4000_0000, 0x18B, 0x201):
        send(port, can_id, b"1234")
    came = [f"{can_id:03X}" for can_id, _, _ in drained(bus)]
    bus.close()
    port.close()
    assert set(identifiers(NODES)) <= received, (
        f"the kernel knows only {sorted(received)}"
    )
    assert came == ["18B"], came
    return (
        f"{len(received)} identifiers in rcvlist_sff; of 5 frames the 1 asked for came"
    )


def overflow() -> str:
    """Frames that the socket lost are counted exactly."""
    bus, port = opened(), open_raw()
    for _ in range(FLOOD):
        send(port, 0x18B, b"1234")
    n = len(drained(bus))
    send(port, 0x18B, b"1234")  # the count is reported with the frame after the loss
    n += len(drained(bus))
    dropped = bus.dropped
    bus.close()
    port.close()
    assert dropped > 0, f"{n} came"
    assert n + dropped == FLOOD + 1, f"{n} came, {dropped} counted"
    return f"of {FLOOD} unread frames {n - 1} kept, {dropped} counted as lost"


def periodic() -> str:
    """The kernel sends by itself, at the configured rate."""
    bus = opened()
    task = bus.send_periodically(SYNC, 1.0 / SYNC_HZ)
    frames: list[Frame] = []
    end_s = time.monotonic() + SYNC_S
    while time.monotonic() < end_s:
        frames += bus.receive(0.1)
    n_sent = can_interface.periodic_frames()
    task.stop()
    drained(bus)
    after = drained(bus)
    bus.close()
    steps_ms = np.diff([stamp_ns for _, _, stamp_ns in frames]) * 1e-6
    assert n_sent >= len(frames) > 0, f"{n_sent} sent, {len(frames)} came"
    assert not after, f"{len(after)} after the end"
    usual_ms = float(np.median(steps_ms))  # a busy host stops the guest now and then
    assert abs(usual_ms - 1e3 / SYNC_HZ) < 0.5, f"{usual_ms:.3f} ms"
    return (
        f"{len(frames)} in {SYNC_S:g} s, {n_sent} by its own count; the usual step "
        f"{usual_ms:.3f} ms, the longest {steps_ms.max():.1f} ms"
    )


def cost() -> str:
    """How long a frame takes that is read from the socket, and by the library."""
    port = open_raw()
    took_us = []
    bus = opened()
    for _ in range(N_FRAMES):
        send(port, 0x18B, b"1234")
    begun_ns = time.perf_counter_ns()
    n = len(drained(bus))
    took_us.append((time.perf_counter_ns() - begun_ns) * 1e-3 - 50e3)
    bus.close()
    library = can.Bus(NAME, "socketcan", ignore_config=True)
    for _ in range(N_FRAMES):
        send(port, 0x18B, b"1234")
    begun_ns = time.perf_counter_ns()
    while library.recv(0) is not None:
        pass
    took_us.append((time.perf_counter_ns() - begun_ns) * 1e-3)
    library.shutdown()
    port.close()
    ours_us, theirs_us = (t / N_FRAMES for t in took_us)
    assert n == N_FRAMES, f"{n} of {N_FRAMES} came"
    assert ours_us < theirs_us, f"{ours_us:.0f} us, python-can {theirs_us:.0f} us"
    return f"{ours_us:.0f} us a frame, python-can's recv {theirs_us:.0f} us (emulated)"


def down() -> str:
    """An interface that is taken down ends the reading, and opening it again."""
    bus = opened()
    can_interface.ip("set", NAME, "down")
    errors = []
    for attempt in (lambda: bus.receive(1.0), lambda: bus.send(SYNC, b"")):
        try:
            attempt()
        except DeviceError as error:
            errors.append(str(error))
    bus.close()
    can_interface.ip("set", NAME, "up")
    assert len(errors) == 2, errors
    bus = opened()
    port = open_raw()
    send(port, SYNC, b"")
    n = len(drained(bus))
    bus.close()
    port.close()
    assert n == 1, f"{n} frames after it was up again"
    return errors[0]


async def check_bus(table: Table) -> None:
    await table.check("time stamps of the kernel", stamps)
    await table.check("filters of the kernel", filters)
    await table.check("lost frames are counted", overflow)
    await table.check("SYNC by the kernel (broadcast manager)", periodic)
    await table.check("what reading a frame costs", cost)
    await table.check("interface down, and up again", down)
