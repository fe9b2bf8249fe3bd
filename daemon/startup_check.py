"""Devices and broker at the start: all are there, or their absence is reported.

By hand a daemon that lacks one of them reports it and ends. As a service it
starts without: it reports it all the same, keeps trying, and uses what is there.
"""

import asyncio
import logging
from collections.abc import Coroutine
from typing import Any

from traverse.daemon.acquisition.device import Device
from traverse.daemon.inputs import (
    DEVICES_ANSWER_S,
    UNREACHABLE,
    StartupError,
    check_devices,
)
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.mqtt.connection import BrokerConnection

log = logging.getLogger(__name__)

BROKER_ANSWER_S = 12.0  # in either version of MQTT


class StartupCheck:
    """Waits for all that the daemon needs.

    Args:
        devices: all of the configuration, their drivers started.
        publisher: of the broker.
        events: receives reports of absent devices.
        keep_trying: begin without what cannot be reached.

    Attributes:
        broker_state_known: to be set when the connection is known to be there, or not.
    """

    def __init__(
        self,
        devices: list[Device],
        publisher: BrokerConnection,
        events: EventLog,
        *,
        keep_trying: bool,
    ) -> None:
        self._devices = devices
        self._publisher = publisher
        self._events = events
        self._keep_trying = keep_trying
        self.broker_state_known = asyncio.Event()

    @property
    def longest_s(self) -> float:
        """How long it may take."""
        return DEVICES_ANSWER_S * len(self._devices) + BROKER_ANSWER_S

    async def wait(self, stopping: asyncio.Event) -> None:
        """Wait, or stop when the daemon is requested to end.

        Raises:
            StartupError: something is missing or does not match; lists all.
        """
        await _unless(stopping, self._check())

    async def broker(self, stopping: asyncio.Event) -> None:
        """Wait for the permanent connection, or for the report of its failure."""
        await _unless(stopping, self._told())

    async def _told(self) -> None:
        await self.broker_state_known.wait()

    async def _check(self) -> None:
        failures = await check_devices(self._devices)
        reason = await self._publisher.probe()
        if reason is not None:
            where = self._publisher.address
            # What is more than its absence has a remedy of its own.
            remedy = "" if ";" in reason else "; start it, or correct [broker]"
            failures.append((UNREACHABLE, f"broker {where}: {reason}{remedy}"))
        if not failures:
            return
        worst = min(status for status, _ in failures)
        if worst < UNREACHABLE or not self._keep_trying:
            raise StartupError([text for _, text in failures], worst)
        for _, text in failures:
            log.warning("%s; it is tried again and again", text)
        for device in self._devices:
            if device.state == "starting":
                device.state = "lost"
                lost = device.last_loss
                self._events.change(
                    True,
                    "error",
                    "device.lost",
                    "no answer since the start" if lost is None else lost.reason,
                    source=device.section.id,
                    remedy="check power and cable" if lost is None else lost.remedy,
                )


async def _unless(stopping: asyncio.Event, work: Coroutine[Any, Any, None]) -> None:
    """Await this, or cancel it when the daemon is requested to end."""
    working = asyncio.ensure_future(work)
    ending = asyncio.ensure_future(stopping.wait())
    await asyncio.wait((working, ending), return_when=asyncio.FIRST_COMPLETED)
    for task in (working, ending):
        task.cancel()
    result, _ = await asyncio.gather(working, ending, return_exceptions=True)
    if isinstance(result, Exception):
        raise result
