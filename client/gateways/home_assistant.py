"""An arm as a device of Home Assistant: a retained announcement, and a state.

Home Assistant reads no MessagePack, so the state is published in JSON, below the topic
of the announcement: one line of a broker's access list allows all of it.
"""

import asyncio
import contextlib
import hashlib
import json
import re
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, get_args

from traverse.broker.address import BrokerAddress
from traverse.broker.errors import MqttError
from traverse.broker.packets import Message
from traverse.client.cancel_tasks import cancel_tasks
from traverse.client.daemon_pulse import DaemonPulse, as_offline
from traverse.client.errors import BrokerUnreachableError
from traverse.client.gateways.outlets import Report
from traverse.client.mqtt.connection import IncomingMessage, ReconnectingConnection
from traverse.protocol import topics
from traverse.protocol.encoding import decode
from traverse.protocol.message_error import MessageError
from traverse.protocol.messages import Health, Status
from traverse.strict_toml.files import text_of

CONNECT_S = 10.0
_NOT_IN_ID = re.compile(r"[^a-zA-Z0-9_-]")

ENTITIES: dict[str, dict[str, Any]] = json.loads(
    text_of(Path(__file__).with_name("home_assistant.json"))
)
ENTITIES["state"]["options"] = get_args(Status.model_fields["state"].annotation)
"""By the key of the state that each shows, as Home Assistant's MQTT integration has it:
https://www.home-assistant.io/integrations/mqtt/#device-discovery-payload"""


def announcement(arm: str, device: str, base: str, keys: set[str]) -> dict[str, Any]:
    """Return the discovery payload of an arm.

    Args:
        arm: its name.
        device: identifier of the device.
        base: topic of the device, above `state` and `availability`.
        keys: of the state, of those that have a value.
    """
    components: dict[str, dict[str, Any]] = {}
    for key, entity in ENTITIES.items():
        if key in keys:
            common = {"unique_id": f"{device}_{key}"}
            value = {"value_template": f"{{{{ value_json.{key} }}}}"}
            components[key] = common | value | entity
            if "json_attributes_template" in entity:
                components[key]["json_attributes_topic"] = f"{base}/state"
    return {
        "device": {
            "identifiers": [device],
            "name": arm,
            "manufacturer": "Traverse",
            "model": "Articulated-arm coordinate measuring machine",
        },
        "origin": {"name": "traverse", "sw_version": version("traverse-cmm")},
        "state_topic": f"{base}/state",
        "availability_topic": f"{base}/availability",
        "components": components,
    }


def state_of(
    status: Status, health: Health | None, last_check: str | None
) -> dict[str, Any]:
    """Summarise a daemon's messages; figures of one that is away are null.

    Args:
        status: the latest.
        health: the latest, if there is one.
        last_check: time of the last daily check, ISO 8601.
    """
    alarms = [
        alarm.model_dump(include={"severity", "code", "source", "text", "remedy"})
        for alarm in status.alarms
    ]
    current_health = health if status.online else None
    return {
        "online": status.online,
        "state": status.state,
        "problem": any(alarm["severity"] != "info" for alarm in alarms),
        "alarms": alarms,
        "temperature_c": current_health and current_health.temperatures_c.get("arm"),
        "points": current_health and current_health.counters.get("points_captured", 0),
        "points_waiting": current_health and current_health.outbox.unsent,
        "last_check": last_check,
    }


class HomeAssistantGateway:
    """Shows an arm in Home Assistant while this runs.

    Args:
        prefix: topic of Home Assistant's discovery.
        report: called with messages for people.
        last_check: returns the time of the arm's last daily check; not called on the
            event loop's thread.
    """

    def __init__(
        self,
        arm: str,
        address: BrokerAddress,
        prefix: str,
        report: Report,
        last_check: Callable[[], str | None],
    ) -> None:
        self._arm = arm
        plain = _NOT_IN_ID.sub("_", arm)
        if plain != arm:  # another arm may have the same plain name
            plain += f"_{hashlib.sha256(arm.encode()).hexdigest()[:8]}"
        self._device = f"traverse_{plain}"
        self.base = f"{prefix}/device/{self._device}"
        self._report = report
        self._last_check = last_check
        away = Message(f"{self.base}/availability", b"offline", qos=1, retain=True)
        self._link = ReconnectingConnection(address, will=away)
        self._status: Status | None = None
        self._health: Health | None = None
        self._news = asyncio.Event()
        self._pulse = DaemonPulse(self._news.set)
        self._sent: dict[str, bytes] = {}

    async def run(self) -> None:
        """Announce the arm and follow it, until cancelled.

        Raises:
            BrokerUnreachableError: there is no connection at first.
        """
        for topic_of in (topics.status_topic, topics.health_topic, topics.clock_topic):
            self._link.topics[topic_of(self._arm)] = 0
        connecting = asyncio.create_task(self._link.run(self._take, self._link_changed))
        following = asyncio.create_task(self._pulse.run())
        try:
            await self._link.wait_first(CONNECT_S)
            self._report(f"waiting for what {self._arm} says of itself")
            while True:
                await self._news.wait()
                self._news.clear()
                try:
                    await self._show()
                except MqttError:
                    self._sent.clear()  # all of it again at the next connection
        finally:
            with contextlib.suppress(MqttError):  # then the will says so
                await self._send("availability", b"offline")
            await cancel_tasks([connecting, following])

    async def remove(self) -> None:
        """Take the arm out of Home Assistant: empty retained messages.

        Raises:
            BrokerUnreachableError: there is no connection.
        """
        connecting = asyncio.create_task(self._link.run(self._take, self._link_changed))
        try:
            await self._link.wait_first(CONNECT_S)
            for topic in ("config", "state", "availability"):
                await self._send(topic, b"")
            self._report(f"{self._arm} is taken out of {self.base}")
        except MqttError as error:
            raise BrokerUnreachableError(str(error)) from error
        finally:
            await cancel_tasks([connecting])

    def _take(self, arrived: IncomingMessage) -> None:
        if arrived.topic == topics.clock_topic(self._arm):
            self._pulse.beat()
            return
        try:
            if arrived.topic == topics.status_topic(self._arm):
                self._status = decode(Status, arrived.payload)
            else:
                self._health = decode(Health, arrived.payload)
        except MessageError as error:
            self._report(f"message on {arrived.topic} left out: {error}")
        self._news.set()

    def _link_changed(self, is_connected: bool) -> None:
        if is_connected:
            self._news.set()
        else:  # the will has been published
            self._sent.clear()
            self._pulse.reset()

    async def _show(self) -> None:
        if self._status is None:
            return  # nothing is known of such an arm
        if not self._sent:
            self._report(f"{self._arm} is shown by {self.base}/config")
        checked = await asyncio.to_thread(self._last_check)
        is_silent = self._status.online and self._pulse.is_silent
        status = as_offline(self._status) if is_silent else self._status
        state = state_of(status, self._health, checked)
        # A time that was never is none that Home Assistant reads.
        known = state.keys() - ({"last_check"} if checked is None else set())
        config = announcement(self._arm, self._device, self.base, known)
        await self._send("config", json.dumps(config).encode())
        await self._send("state", json.dumps(state).encode())
        await self._send("availability", b"online")

    async def _send(self, topic: str, payload: bytes) -> None:
        if self._sent.get(topic) != payload:
            await self._link.publish(f"{self.base}/{topic}", payload, retain=True)
            self._sent[topic] = payload
