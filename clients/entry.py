"""Getting in at a broker, or hearing in words why not."""

import logging
from typing import Any, Self

import aiomqtt
from paho.mqtt.client import Client as PahoClient
from paho.mqtt.client import DisconnectFlags
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from clients.address import BrokerAddress
from clients.reasons import SilentEndError, is_refusal, reason_of


class _Faults(logging.Handler):
    """Keeps the last exception that paho logs instead of raising it.

    With TLS 1.3 that is where the broker's reason is: it looks at our certificate when
    the handshake is over for us.
    """

    last: BaseException | None = None

    def emit(self, record: logging.LogRecord) -> None:
        arguments = record.args if isinstance(record.args, tuple) else ()
        for one in arguments:
            if isinstance(one, BaseException):
                self.last = one


class EntryRefusedError(aiomqtt.MqttError):
    """The broker does not let us in, and waiting will not change that."""


class EnteringClient(aiomqtt.Client):
    """A connection to a broker that says why it did not come about.

    Args:
        address: of the broker.
        options: further ones of aiomqtt's client.

    Raises:
        EntryRefusedError: a file of the address cannot be used.
    """

    def __init__(
        self,
        address: BrokerAddress,
        **options: Any,  # noqa: ANN401 - of aiomqtt, which has many kinds
    ) -> None:
        self._address = address
        self._is_left = False
        self._faults = _Faults()
        # All that it would say is raised, too.
        logger = logging.Logger("paho", logging.ERROR)  # noqa: LOG001 - this connection's
        logger.addHandler(self._faults)
        try:
            where = address.options()
        except OSError as error:
            raise EntryRefusedError(str(error)) from error
        super().__init__(logger=logger, **where, **options)

    async def __aenter__(self) -> Self:
        """Connect.

        Raises:
            EntryRefusedError: the broker does not want us, or we do not trust it.
            aiomqtt.MqttError: it is not there. Both say what to do.
        """
        try:
            return await super().__aenter__()
        except aiomqtt.MqttError as error:
            cause = error.__cause__ = self._faults.last or error.__context__
            refused = is_refusal(error) or is_refusal(cause)
            kind = EntryRefusedError if refused else aiomqtt.MqttError
            raise kind(reason_of(error, self._address)) from error
        except BaseException:
            self._is_left = True
            self._client.disconnect()  # aiomqtt would leave it as it is
            raise

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
            self._connected.set_exception(SilentEndError())
