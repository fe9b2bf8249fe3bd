"""An arm in Home Assistant: what is retained at a real broker, and what templates of it
give; the rules of its discovery are written out here.
"""

import asyncio
import contextlib
import json
import re
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import aiomqtt
import jinja2
import pytest

from tests.client.virtual_daemon import VirtualDaemon
from tests.mosquitto import Mosquitto
from tests.protocol.message_examples import HEALTH, STATUS
from traverse.broker.address import BrokerAddress
from traverse.client.cancel_tasks import cancel_tasks
from traverse.client.errors import BrokerUnreachableError
from traverse.client.gateways import home_assistant
from traverse.client.gateways.home_assistant import HomeAssistantGateway, state_of
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")

# Home Assistant's own: what a device and an entity must and may have.
TOPIC = re.compile(r"homeassistant/device/[a-zA-Z0-9_-]+/config")
SHARED = {"platform", "unique_id", "name", "value_template", "device_class"}
ATTRIBUTES = {"json_attributes_topic", "json_attributes_template"}
MAY = {
    "binary_sensor": SHARED | ATTRIBUTES,
    "sensor": SHARED
    | {"options", "state_class", "unit_of_measurement", "suggested_display_precision"},
}
CHECKED = "2026-11-23T06:10:00Z"


class HomeAssistant:
    def __init__(self) -> None:
        self.retained: dict[str, str] = {}

    async def follow(self, client: aiomqtt.Client) -> None:
        await client.subscribe("homeassistant/#", qos=1)
        async for message in client.messages:
            assert isinstance(message.payload, bytes)
            self.retained[str(message.topic)] = message.payload.decode()

    def of(self, kind: str) -> str:
        """Retained messages that end with this; empty while there are none."""
        topics = [
            self.retained[topic] for topic in self.retained if topic.endswith(kind)
        ]
        return topics[0] if topics else ""

    @property
    def state(self) -> dict[str, Any]:
        return dict(json.loads(self.of("/state") or "{}"))

    def shown(self) -> dict[str, str]:
        environment = jinja2.Environment(undefined=jinja2.StrictUndefined)
        environment.filters["to_json"] = json.dumps
        config = json.loads(self.of("/config"))
        texts = {k: e["value_template"] for k, e in config["components"].items()}
        problem = config["components"]["problem"]
        texts["attributes"] = problem["json_attributes_template"]
        return {
            key: environment.from_string(text).render(value_json=self.state)
            for key, text in texts.items()
        }


@pytest.fixture
async def home(mosquitto: Mosquitto) -> AsyncIterator[HomeAssistant]:
    home = HomeAssistant()
    async with aiomqtt.Client(mosquitto.host, mosquitto.port) as client:
        task = asyncio.create_task(home.follow(client))
        yield home
        await cancel_tasks([task])
    async with aiomqtt.Client(mosquitto.host, mosquitto.port) as client:
        for topic in home.retained:
            await client.publish(topic, b"", retain=True)


def gateway_of(
    arm: str, mosquitto: Mosquitto, reports: list[str]
) -> HomeAssistantGateway:
    address = BrokerAddress(mosquitto.host, mosquitto.port)
    return HomeAssistantGateway(
        arm, address, "homeassistant", reports.append, lambda: CHECKED
    )


@contextlib.asynccontextmanager
async def running(gateway: HomeAssistantGateway) -> AsyncIterator[None]:
    task = asyncio.create_task(gateway.run())
    try:
        yield
    finally:
        await cancel_tasks([task])


async def test_an_arm_is_announced_followed_and_taken_out(
    home: HomeAssistant, virtual: VirtualDaemon, mosquitto: Mosquitto
) -> None:
    arm, reports = virtual.arm, list[str]()
    gateway = gateway_of(arm, mosquitto, reports)
    async with running(gateway):
        async with virtual.running():
            alarmed = STATUS.model_copy(update={"arm": arm, "online": True})
            await virtual.publish(alarmed)
            await virtual.publish(HEALTH.model_copy(update={"arm": arm}))
            await until(lambda: home.state.get("points") is not None)
            await until(lambda: home.of("/availability") == "online")
            (topic,) = [name for name in home.retained if name.endswith("/config")]
            assert topic == f"homeassistant/device/traverse_{arm}/config"
            assert TOPIC.fullmatch(topic)
            check_announcement(json.loads(home.of("/config")), home.retained)
            shown = home.shown()
            attributes = json.loads(shown.pop("attributes"))["alarms"]
            assert [alarm["code"] for alarm in attributes] == ["device.lost"]
            assert shown == {
                "online": "ON",
                "state": alarmed.state,
                "problem": "ON",
                "temperature_c": str(HEALTH.temperatures_c["arm"]),
                "points": str(HEALTH.counters["points_captured"]),
                "points_waiting": str(HEALTH.outbox.unsent),
                "last_check": CHECKED,
            }
            virtual.is_stopped = True
            await until(lambda: home.state["online"] is False)
            assert home.state["state"] == "offline"
            virtual.is_stopped = False
            await until(lambda: home.state["online"] is True)
        # The daemon has gone: figures are not those of now.
        await until(lambda: home.state["online"] is False)
        assert home.shown()["points"] == home.shown()["temperature_c"] == "None"
        assert home.of("/availability") == "online"
    await until(lambda: home.of("/availability") == "offline")
    await gateway_of(arm, mosquitto, reports).remove()
    await until(lambda: not any(home.retained.values()))
    assert reports[-1] == f"{arm} is taken out of homeassistant/device/traverse_{arm}"


def check_announcement(config: dict[str, Any], known: dict[str, str]) -> None:
    """By Home Assistant's rules."""
    assert config["device"]["identifiers"]
    assert config["origin"]["name"]
    for topic in (config["state_topic"], config["availability_topic"]):
        assert topic in known
    for entity in config["components"].values():
        assert entity.keys() <= MAY[entity["platform"]]
        assert entity["unique_id"]
    ids = {entity["unique_id"] for entity in config["components"].values()}
    assert len(ids) == len(config["components"])


async def test_it_is_there_again_after_the_broker_was_away(
    make_mosquitto: Callable[[], Mosquitto],
) -> None:
    broker, arm = make_mosquitto(), "Arm of 2nd hall"
    virtual = VirtualDaemon(arm, broker.host, broker.port)
    async with running(gateway_of(arm, broker, [])):
        for _ in range(2):
            seen = HomeAssistant()
            async with (
                virtual.running(),
                aiomqtt.Client(broker.host, broker.port) as client,
            ):
                task = asyncio.create_task(seen.follow(client))
                await until(lambda: seen.of("/availability") == "online")  # noqa: B023
                assert seen.state["state"] == "ready"
                assert any(map(TOPIC.fullmatch, seen.retained))
                await cancel_tasks([task])
            broker.stop()
            broker.start()  # it has forgotten all


async def test_a_broker_that_is_not_there_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(home_assistant, "CONNECT_S", 0.2)
    gateway = gateway_of("bench-7", Mosquitto(tmp_path), [])  # not started
    for work in (gateway.run, gateway.remove):
        with pytest.raises(BrokerUnreachableError):
            await work()


def test_what_is_only_a_remark_is_no_problem() -> None:
    remark = STATUS.alarms[0].model_copy(update={"severity": "info"})
    status = STATUS.model_copy(update={"alarms": (remark,)})
    state = state_of(status, None, None)
    assert (state["problem"], len(state["alarms"])) == (False, 1)
