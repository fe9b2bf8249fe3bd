import asyncio
import contextlib

import aiomqtt

from traverse.broker.address import BrokerAddress
from traverse.daemon.mqtt.connection import BrokerConnection
from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage, OutgoingQueue
from traverse.testing.waiting import until

STATUS = "traverse/bench-7/status"


class Bench:
    def __init__(self, address: BrokerAddress) -> None:
        self.queue = OutgoingQueue()
        self.received = []
        self.changes = []
        self.publisher = BrokerConnection(
            address=address,
            client_id="traverse-bench-7",
            will=OutgoingMessage(STATUS, b"gone", qos=1, retain=True),
            encoding="msgpack",
            queue=self.queue,
            subscriptions=("traverse/bench-7/cmd/+",),
            changed=lambda *change: self.changes.append(change),
        )

    @contextlib.asynccontextmanager
    async def running(self, receive=None):
        assert await self.publisher.probe() is None  # as the service does
        receive = receive or self.received.append
        task = asyncio.create_task(self.publisher.run(receive))
        try:
            await until(lambda: self.publisher.state == "connected", "a connection")
            yield self
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    def point(self, name: str) -> None:
        self.queue.offer(
            "point", OutgoingMessage("traverse/bench-7/point", name.encode(), 1)
        )

    async def all_sent(self) -> None:
        await until(lambda: not self.queue.waiting("point"), "all points to be sent")


class Witness:
    def __init__(self, port: int, topic: str, **options) -> None:
        self.messages = []
        self._topic = topic
        self.client = aiomqtt.Client(
            "127.0.0.1",
            port,
            **{"protocol": aiomqtt.ProtocolVersion.V5, "timeout": 5, **options},
        )

    async def __aenter__(self):
        await self.client.__aenter__()
        await self.client.subscribe(self._topic, qos=1)
        self._task = asyncio.create_task(self._collect())
        return self

    async def _collect(self) -> None:
        async for message in self.client.messages:
            self.messages.append(message)

    async def __aexit__(self, *error):
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        with contextlib.suppress(aiomqtt.MqttError):
            await self.client.__aexit__(*error)

    async def payloads(self, n: int) -> list[bytes]:
        await until(lambda: len(self.messages) >= n, f"{n} messages")
        return [message.payload for message in self.messages]


def address(broker, **options) -> BrokerAddress:
    return BrokerAddress(broker.host, broker.port, **options)
