"""Driver of a recording: replays a device's deliveries at their pace.

Times are moved to the present, and stretched if the speed is not 1. A latch cannot be
requested: points on command are made from the stream.
"""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from traverse.drivers.base.delivery_maps import delivery_from_map
from traverse.drivers.base.driver import Driver, DriverOptions
from traverse.drivers.base.values import (
    CountSamples,
    Delivery,
    DeviceError,
    DeviceNotFoundError,
    DeviceRefusedError,
    DeviceUp,
    LatchedCounts,
    StreamStarted,
)
from traverse.recording.maps import bytes_to_map
from traverse.recording.run_reader import RunReader

LOOK_S = 0.05


class ReplayOptions(DriverOptions):
    """Options of the driver `replay`.

    Without ``source`` the device has the same id in the recording.
    """

    file: str = Field(min_length=1)
    source: str | None = Field(default=None, pattern=r"^[A-Za-z0-9_-]+$")
    speed: float = Field(default=1.0, ge=0.1, le=100.0)
    repeat: bool = False

    @property
    def where(self) -> str:
        return self.file


class ReplayDriver(Driver):
    """Plays one device of a recording."""

    options: ReplayOptions
    options_class = ReplayOptions

    def _prepare(self) -> None:
        options = self.options
        self._path = Path(options.file)
        self._source = options.source or self.device
        self._speed = options.speed
        self._repeat = options.repeat
        self._reader: RunReader | None = None
        self._is_played = False
        self._began: tuple[int, int] | None = None
        self._playing: StreamStarted | None = None
        self._is_asked = False

    def request_stream(self, rate_hz: float) -> None:
        """Report the stream again, at the recording's rate."""
        self._is_asked = True

    def _connect(self) -> None:
        if self._is_played:
            raise DeviceError(
                f"the recording {self._path} has been played to its end",
                "set repeat = true to begin anew, or start the daemon again",
            )
        self._began = self._playing = None
        try:
            self._reader = RunReader(self._path)
        except OSError as error:
            raise DeviceNotFoundError(
                f"{self._path} cannot be read: {error.strerror}", "check its path"
            ) from error
        except ValueError as error:
            raise DeviceRefusedError(
                str(error), "name a recording of the daemon"
            ) from error

    def _serve(self) -> None:
        try:
            for at_ns, delivery in self._deliveries():
                if not self._wait(at_ns):
                    return
                self._hand_over(delivery)
        except ValueError as error:
            raise DeviceRefusedError(
                f"{self._path}: {error}", "name a whole recording"
            ) from error
        self._is_played = not self._repeat
        raise DeviceError(
            f"the recording {self._path} has ended",
            "it begins anew" if self._repeat else "start the daemon again",
        )

    def _disconnect(self) -> None:
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def _deliveries(self) -> Iterator[tuple[int, Delivery]]:
        """Yield deliveries of the device with their recorded instants."""
        is_first = True
        for entry in self._reader or ():
            kind, _, subtopic = entry.topic.partition("/")
            if kind == "device" and subtopic.partition("/")[0] == self._source:
                table = bytes_to_map(entry.content)
                yield _at_ns(table), delivery_from_map(table)
            elif entry.topic == "steps" and is_first:
                table = bytes_to_map(entry.content)
                if table.get("is") == "state":
                    is_first = False
                    for device in table["value"]["devices"]:
                        if device["device"] == self._source:
                            yield _at_ns(table), delivery_from_map(device)

    def _wait(self, at_ns: int) -> bool:
        if self._began is None:
            self._began = at_ns, self._now_ns()
        while not self._stopping:
            if self._is_asked and self._playing is not None:
                self._is_asked = False
                self._deliver_state(self._playing)
            self._report_counters()
            left_s = (self._moved(at_ns) - self._now_ns()) * 1e-9
            if left_s <= 0.0:
                return True
            time.sleep(min(left_s, LOOK_S))
        return False

    def _moved(self, then_ns: int) -> int:
        then0_ns, now0_ns = self._began or (0, 0)
        return now0_ns + round((then_ns - then0_ns) / self._speed)

    def _hand_over(self, delivery: Delivery) -> None:
        match delivery:
            case CountSamples():
                self._counters["samples_received"] += len(delivery.seq)
                self._delivery_queue.put(self._moved_samples(delivery))
            case LatchedCounts():
                if delivery.input is not None:
                    self._counters["edges_received"] += 1
                    self._delivery_queue.put(
                        replace(
                            delivery,
                            device=self.device,
                            received_ns=self._moved(delivery.received_ns),
                            sample_time_ns=self._moved(delivery.sample_time_ns),
                        )
                    )
            case DeviceUp():
                rate_hz = delivery.identity.max_rate_hz * self._speed
                identity = replace(
                    delivery.identity,
                    latches=False,
                    max_rate_hz=rate_hz,
                    reads_in_turn=False,  # it is repeated at its one rate
                )
                self._deliver_state(
                    replace(delivery, device=self.device, identity=identity)
                )
            case StreamStarted():
                rate_hz = delivery.rate_hz * self._speed
                self._playing = StreamStarted(self.device, delivery.stream, rate_hz)
                self._deliver_state(self._playing)
            case _:
                self._delivery_queue.put(replace(delivery, device=self.device))

    def _moved_samples(self, samples: CountSamples) -> CountSamples:
        then0_ns, now0_ns = self._began or (0, 0)
        after_ns = np.rint((samples.sample_time_ns - then0_ns) / self._speed)
        skews_ns = {
            name: np.rint(values_ns / self._speed).astype(np.int32)
            for name in ("skew_ns", "skew_bound_ns")
            if (values_ns := getattr(samples, name)) is not None
        }
        return replace(
            samples,
            device=self.device,
            received_ns=self._moved(samples.received_ns),
            sample_time_ns=now0_ns + after_ns.astype(np.int64),
            **skews_ns,
        )


def _at_ns(table: dict[str, Any]) -> int:
    at_ns = table.get("at_ns")
    if not isinstance(at_ns, int):
        raise ValueError(f"a step without its instant, at_ns is {at_ns!r}")
    return at_ns
