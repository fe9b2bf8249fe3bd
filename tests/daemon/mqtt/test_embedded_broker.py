"""Retained messages of the embedded broker, as a client of another library has them."""

import asyncio
import contextlib
from collections.abc import AsyncIterator

import aiomqtt
import paho.mqtt.client as paho
import pytest

from traverse.daemon.mqtt.embedded_broker import embedded_broker
from traverse.testing.waiting import until

HOST = "127.0.0.1"
RETAINED = {
    "traverse/a/status": b"a",
    "traverse/b/status": b"b",
    "traverse/a/health": b"h",
    "elsewhere": b"e",
}


class Subscriber:
    """A plain client of paho that keeps what it receives."""

    def __init__(self, port: int) -> None:
        self.received: list[tuple[str, bytes, bool]] = []
        self.subscribed = 0
        self.client = paho.Client(paho.CallbackAPIVersion.VERSION2)
        self.client.on_message = lambda _client, _data, message: self.received.append(
            (message.topic, message.payload, message.retain)
        )
        self.client.on_subscribe = self._on_subscribe
        self.client.connect(HOST, port)
        self.client.loop_start()

    def _on_subscribe(self, *_: object) -> None:
        self.subscribed += 1

    async def subscribe(self, topic_filter: str) -> None:
        wanted = self.subscribed + 1
        self.client.subscribe(topic_filter, qos=1)
        await until(lambda: self.subscribed >= wanted, f"answer to {topic_filter}")

    async def settled(self, publisher: aiomqtt.Client, topic: str) -> list[str]:
        """Topics of the retained messages so far; a later message has followed them."""
        await publisher.publish(topic, b"last", qos=1)
        await until(lambda: (topic, b"last", False) in self.received, "the last one")
        topics = sorted(topic for topic, _, retained in self.received if retained)
        self.received.clear()
        return topics


@contextlib.asynccontextmanager
async def subscribing(port: int) -> AsyncIterator[Subscriber]:
    subscriber = await asyncio.to_thread(Subscriber, port)
    try:
        yield subscriber
    finally:
        subscriber.client.disconnect()
        await asyncio.to_thread(subscriber.client.loop_stop)


async def test_retained_messages_go_to_their_subscribers_alone() -> None:
    async with (
        embedded_broker(0) as port,
        aiomqtt.Client(HOST, port) as publisher,
        subscribing(port) as everything,
    ):
        # Others subscribe to everything: that is none of a new client's business.
        await everything.subscribe("#")
        await everything.subscribe("traverse/+/status")
        for topic, payload in RETAINED.items():
            await publisher.publish(topic, payload, qos=1, retain=True)

        async with subscribing(port) as plain:
            await plain.subscribe("traverse/a/point")
            assert await plain.settled(publisher, "traverse/a/point") == []
            await plain.subscribe("traverse/+/status")
            received = await plain.settled(publisher, "traverse/a/point")
            assert received == ["traverse/a/status", "traverse/b/status"]
            await plain.subscribe("traverse/+/status")  # again
            received = await plain.settled(publisher, "traverse/a/point")
            assert received == ["traverse/a/status", "traverse/b/status"]
            plain.client.unsubscribe("traverse/+/status")
            await plain.subscribe("traverse/a/health")
            received = await plain.settled(publisher, "traverse/a/point")
            assert received == ["traverse/a/health"]

        async with subscribing(port) as wide:
            await wide.subscribe("#")
            received = await wide.settled(publisher, "traverse/a/point")
            assert received == sorted(RETAINED)  # nothing that begins with $

        await publisher.publish("traverse/b/status", b"", qos=1, retain=True)
        async with subscribing(port) as after:
            await after.subscribe("traverse/#")
            received = await after.settled(publisher, "traverse/a/point")
            assert received == ["traverse/a/health", "traverse/a/status"]


@pytest.mark.parametrize("topic_filter", ["traverse/+/point", "+/+/point"])
async def test_the_subscriber_of_the_guide_receives_points_alone(
    topic_filter: str,
) -> None:
    async with (
        embedded_broker(0) as port,
        aiomqtt.Client(HOST, port) as publisher,
        subscribing(port) as others,
    ):
        await others.subscribe("traverse/#")
        await publisher.publish("traverse/a/status", b"s", qos=1, retain=True)
        async with aiomqtt.Client(HOST, port) as client:
            await client.subscribe(topic_filter, qos=1)
            await publisher.publish("traverse/a/point", b"p", qos=1)
            async with asyncio.timeout(20.0):
                first = await anext(aiter(client.messages))
            assert (str(first.topic), first.payload) == ("traverse/a/point", b"p")
