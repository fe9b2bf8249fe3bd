"""An MQTT client that learns why it was refused, and ends when requested."""

import asyncio
import logging
import math
import socket
from collections.abc import Awaitable
from typing import Any, Self, TypeVar

import aiomqtt
from paho.mqtt.client import Client as PahoClient
from paho.mqtt.client import DisconnectFlags
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

T = TypeVar("T")


class ConnectionClosedError(aiomqtt.MqttError):
    """The broker closed the connection before it had answered."""

    def __init__(self) -> None:
        super().__init__("it closes the connection without a word")


class _Faults(logging.Logger):
    """The log of one connection; keeps the last exception that paho writes there.

    With TLS 1.3 that is where the broker's reason is: it looks at our certificate when
    the handshake is over for us. All else that paho would say is raised, too.
    """

    last: BaseException | None = None

    def handle(self, record: logging.LogRecord) -> None:
        arguments = record.args if isinstance(record.args, tuple) else ()
        for one in arguments:
            if isinstance(one, BaseException):
                self.last = one


class DiagnosingClient(aiomqtt.Client):
    """A connection to a broker; what kept it from coming about is the error's cause."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self._is_left = False
        self._faults = _Faults("paho", logging.ERROR)
        super().__init__(
            *arguments,
            **options,
            logger=self._faults,
            timeout=5,
            # With Nagle's algorithm one message in a hundred waits 24 ms.
            socket_options=[(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)],
        )

    async def __aenter__(self) -> Self:
        """Connect.

        Raises:
            aiomqtt.MqttError: there is no connection, with the reason.
        """
        try:
            return await super().__aenter__()
        except aiomqtt.MqttError as error:
            raise error from (self._faults.last or error.__context__)
        except BaseException:
            self._is_left = True
            self._client.disconnect()  # aiomqtt would leave it as it is
            raise

    async def _wait_for(
        self,
        fut: Awaitable[T],
        timeout: float | None,  # noqa: ASYNC109 - as aiomqtt declares it
    ) -> T:
        # As aiomqtt's own, but for asyncio.wait_for: up to Python 3.11 that forgets a
        # cancellation that arrives as its work is done, and we would never end.
        timeout_s = self.timeout if timeout is None else timeout
        try:
            async with asyncio.timeout(None if timeout_s == math.inf else timeout_s):
                return await fut
        except TimeoutError:
            raise aiomqtt.MqttError("Operation timed out") from None

    def _on_disconnect(
        self,
        client: PahoClient,
        userdata: Any,  # noqa: ANN401 - as aiomqtt declares it
        flags: DisconnectFlags,
        reason_code: ReasonCode,
        properties: Properties | None = None,
    ) -> None:
        if self._is_left:
            return
        if self._connected.done():
            super()._on_disconnect(client, userdata, flags, reason_code, properties)
        else:  # aiomqtt would wait until its time is over
            self._connected.set_exception(ConnectionClosedError())
