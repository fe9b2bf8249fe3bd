"""Check of devices and broker at the start.

Started by hand, a daemon without one of them reports it and ends; a service reports it,
begins, and keeps trying.
"""

import asyncio
import logging
from collections.abc import Iterable, Sequence

from traverse.daemon.acquisition.device import Device
from traverse.daemon.inputs import REFUSED, UNREACHABLE, StartupError
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.mqtt.connection import BrokerConnection

log = logging.getLogger(__name__)

DEVICES_ANSWER_S = 8.0
BROKER_ANSWER_S = 12.0  # in either version of MQTT


def startup_limit_s(devices: Sequence[Device]) -> float:
    return DEVICES_ANSWER_S * len(devices) + BROKER_ANSWER_S


async def check_startup(
    devices: Sequence[Device],
    connection: BrokerConnection,
    events: EventLog,
    *,
    keep_trying: bool,
) -> None:
    """Wait for all devices and the broker, or only report those that are absent.

    Raises:
        StartupError: lists all that are absent or mismatched.
    """
    failures = await check_devices(devices)
    reason = await connection.probe()
    if reason is not None:
        # What is more than its absence has a remedy of its own.
        remedy = "" if ";" in reason else "; start it, or correct [broker]"
        text = f"broker {connection.address}: {reason}{remedy}"
        failures.append((UNREACHABLE, text))
    if not failures:
        return
    worst = min(status for status, _ in failures)
    if worst < UNREACHABLE or not keep_trying:
        raise StartupError([text for _, text in failures], worst)
    for _, text in failures:
        log.warning("%s; it is tried again and again", text)
    for device in devices:
        if device.state == "starting":
            device.state = "lost"
            lost = device.last_loss
            events.change(
                True,
                "error",
                "device.lost",
                "no answer since the start" if lost is None else lost.reason,
                source=device.section.id,
                remedy="check power and cable" if lost is None else lost.remedy,
            )


async def check_devices(devices: Iterable[Device]) -> list[tuple[int, str]]:
    failures = []
    for device in devices:
        name = f"device {device.section.id}"
        try:
            async with asyncio.timeout(DEVICES_ANSWER_S):
                await device.answered.wait()
        except TimeoutError:
            silent = f"{name}: no answer within {DEVICES_ANSWER_S:g} s"
            failures.append((UNREACHABLE, silent))
            continue
        if device.state == "starting" and device.last_loss is not None:
            lost = device.last_loss
            failures.append((UNREACHABLE, f"{name}: {lost.reason}; {lost.remedy}"))
        failures += [(REFUSED, f"{name}: {text}") for text in device.problems]
    return failures
