"""The devices of a configuration, read for `traverse joints`."""

import asyncio
import contextlib
import sys
import threading
from collections.abc import AsyncIterator, Callable, Sequence

from traverse.cli.common.refusals import UNREACHABLE, refuse
from traverse.daemon.acquisition.device import Device, open_device, running_drivers
from traverse.daemon.config.devices import DeviceSection
from traverse.drivers.base.values import (
    CountSamples,
    DeviceAlarm,
    DeviceLost,
    DeviceUp,
    LatchedCounts,
)
from traverse.drivers.turning import Track, feed_tracks, tracks_of

RATE_HZ = 50.0
REST_SAMPLES = 100
FRESH_SAMPLES = 5
ANSWER_S = 20.0  # for all devices to be found, and for samples at rest


class TurningDevices:
    """All devices with encoders, and the tracks of their channels.

    Attributes:
        alarms: text of each alarm that stands, by its source.
    """

    def __init__(self, devices: Sequence[Device]) -> None:
        self._devices = devices
        self._by_device: dict[str, list[Track]] = {}
        self.alarms: dict[str, str] = {}
        self.names: dict[str, str] = {}
        self._lost: dict[str, DeviceLost] = {}
        self._changed = asyncio.Event()

    @property
    def tracks(self) -> list[Track]:
        return [track for tracks in self._by_device.values() for track in tracks]

    def begin(self) -> None:
        for track in self.tracks:
            track.begin()

    async def connected(self) -> None:
        """Wait for all devices.

        Raises:
            RefusalError: one cannot be reached.
        """
        await self._until(lambda: len(self._by_device) == len(self._devices))
        if not self.tracks:
            refuse("no device of this configuration has encoders")

    async def rested(self) -> None:
        self.begin()
        await self._until(
            lambda: all(track.n_samples >= REST_SAMPLES for track in self.tracks)
        )

    async def settled(self) -> None:
        """Wait for new samples, which contain the whole motion."""
        ends = [track.n_samples + FRESH_SAMPLES for track in self.tracks]
        await self._until(
            lambda: all(
                track.n_samples >= end
                for track, end in zip(self.tracks, ends, strict=True)
            )
        )

    async def _until(self, condition: Callable[[], bool]) -> None:
        try:
            async with asyncio.timeout(ANSWER_S):
                while not condition():
                    for lost in self._lost.values():
                        refuse(f"{lost.reason}; {lost.remedy}", UNREACHABLE)
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            refuse(f"not all devices send samples within {ANSWER_S:g} s", UNREACHABLE)

    async def read(self, device: Device) -> None:
        name = device.section.id
        while True:
            for delivery in await device.delivery_queue.take():
                match delivery:
                    case DeviceUp(identity=identity):
                        self._lost.pop(name, None)
                        self.names[name] = identity.name
                        self._by_device.setdefault(name, tracks_of(name, identity))
                        if identity.moduli_counts:
                            rate_hz = min(RATE_HZ, identity.max_rate_hz)
                            device.driver.request_stream(rate_hz)
                    case DeviceLost():
                        self._lost[name] = delivery
                    case CountSamples() if name in self._by_device:
                        feed_tracks(self._by_device[name], delivery)
                    case LatchedCounts():
                        device.driver.acknowledge(delivery.token)
                    case DeviceAlarm(channel=channel):
                        source = name if channel is None else f"{name}/{channel}"
                        if delivery.raised:
                            self.alarms[source] = f"{delivery.text}: {delivery.remedy}"
                        else:
                            self.alarms.pop(source, None)
            self._changed.set()


@contextlib.asynccontextmanager
async def turning_devices(
    sections: Sequence[DeviceSection],
) -> AsyncIterator[TurningDevices]:
    loop = asyncio.get_running_loop()
    devices = [open_device(section, loop) for section in sections]
    turning = TurningDevices(devices)
    async with running_drivers(devices):
        readers = [asyncio.create_task(turning.read(device)) for device in devices]
        try:
            yield turning
        finally:
            for reader in readers:
                reader.cancel()
            await asyncio.gather(*readers, return_exceptions=True)


def typed_lines() -> "asyncio.Queue[str]":
    """Return a queue of the lines of standard input, and an empty text at its end.

    A thread reads them: a file and a pipe cannot be waited for in the same way.
    """
    lines: asyncio.Queue[str] = asyncio.Queue()
    loop = asyncio.get_running_loop()

    def read() -> None:
        for line in iter(sys.stdin.readline, ""):
            loop.call_soon_threadsafe(lines.put_nowait, line)
        with contextlib.suppress(RuntimeError):  # the command has ended
            loop.call_soon_threadsafe(lines.put_nowait, "")

    threading.Thread(target=read, name="typed-lines", daemon=True).start()
    return lines
