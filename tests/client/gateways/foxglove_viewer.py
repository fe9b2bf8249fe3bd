"""A viewer of Foxglove's WebSocket protocol, without any code of the server's.

The protocol: https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md, with the
subprotocol of the SDK; a message is the operation 1, a subscription's number (uint32),
a time (uint64, ns) and the content.
"""

import asyncio
import base64
import json
import struct
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Self

from google.protobuf import descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.json_format import MessageToDict
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

ASSET = 4  # operation of an answer: request, status, length of an error, it, content


def reader_of(channel: dict[str, Any]) -> Callable[[bytes], Any]:
    """How a channel's contents are read, by the schema that the server gives."""
    if channel["encoding"] == "json":
        return json.loads
    pool = descriptor_pool.DescriptorPool()
    files = FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
    for file in files.file:
        pool.Add(file)
    kind = pool.FindMessageTypeByName(channel["schemaName"])
    message = message_factory.GetMessageClass(kind)
    return lambda content: MessageToDict(
        message.FromString(content), preserving_proto_field_name=True
    )


class Viewer:
    """Subscribes to everything; use with `async with`.

    Attributes:
        channels: by topic, as announced.
        messages: by topic.
        statuses: of the server, by id.
        assets: answers to `fetch`, by request; None: refused.
    """

    def __init__(self, url: str) -> None:
        self._connecting = connect(url, subprotocols=["foxglove.sdk.v1"])
        self.channels: dict[str, dict[str, Any]] = {}
        self.messages: dict[str, list[Any]] = {}
        self.statuses: dict[str, Any] = {}
        self.assets: dict[int, bytes | None] = {}
        self._readers: dict[int, tuple[str, Callable[[bytes], Any]]] = {}

    async def __aenter__(self) -> Self:
        self.connection: ClientConnection = await self._connecting
        self._task = asyncio.create_task(self._run())
        return self

    async def __aexit__(self, *failure: object) -> None:
        await self.connection.close()
        with suppress(ConnectionClosed):  # the server does not answer the closing
            await self._task

    async def _run(self) -> None:
        async for frame in self.connection:
            if isinstance(frame, bytes) and frame[0] == ASSET:
                request, status, n_error = struct.unpack_from("<IBI", frame, 1)
                self.assets[request] = None if status else frame[10 + n_error :]
            elif isinstance(frame, bytes):
                op, number, _ = struct.unpack_from("<BIQ", frame)
                assert op == 1
                topic, read = self._readers[number]
                self.messages.setdefault(topic, []).append(read(frame[13:]))
            else:
                await self._take(json.loads(frame))

    async def _take(self, message: dict[str, Any]) -> None:
        match message["op"]:
            case "advertise":
                for channel in message["channels"]:
                    self.channels[channel["topic"]] = channel
                    self._readers[channel["id"]] = (
                        channel["topic"],
                        reader_of(channel),
                    )
                expected = [
                    {"id": channel["id"], "channelId": channel["id"]}
                    for channel in message["channels"]
                ]
                subscribe = {"op": "subscribe", "subscriptions": expected}
                await self.connection.send(json.dumps(subscribe))
            case "status":
                self.statuses[message["id"]] = message
            case "removeStatus":
                for status_id in message["statusIds"]:
                    self.statuses.pop(status_id, None)

    async def fetch(self, request: int, uri: str) -> None:
        message = {"op": "fetchAsset", "uri": uri, "requestId": request}
        await self.connection.send(json.dumps(message))

    def newest(self, topic: str) -> Any:
        """The last message of a topic; None: there is none yet."""
        return (self.messages.get(topic) or [None])[-1]
