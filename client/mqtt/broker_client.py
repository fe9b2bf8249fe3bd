"""Getting in at a broker with an address, or hearing in words why not."""

from typing import Any, Self

import aiomqtt

from traverse.broker.diagnosing_client import DiagnosingClient
from traverse.broker.reasons import Wording, is_refusal, reason_of
from traverse.client.mqtt.address import BrokerAddress

WORDING = Wording(
    who="this client",
    where="",
    use_tls="give mqtts:// before its name",
    absent="; start it, or correct its address",
)


class AccessRefusedError(aiomqtt.MqttError):
    """The broker does not let us in, and waiting will not change that."""


class ConfiguredClient(DiagnosingClient):
    """A connection to a broker that says why it did not come about.

    Args:
        address: of the broker.
        options: further ones of aiomqtt's client.

    Raises:
        AccessRefusedError: a file of the address cannot be used.
    """

    def __init__(
        self,
        address: BrokerAddress,
        **options: Any,  # noqa: ANN401 - of aiomqtt, which has many kinds
    ) -> None:
        self._address = address
        try:
            where = address.options()
        except OSError as error:
            raise AccessRefusedError(str(error)) from error
        super().__init__(**where, **options)

    async def __aenter__(self) -> Self:
        """Connect.

        Raises:
            AccessRefusedError: the broker does not want us, or we do not trust it.
            aiomqtt.MqttError: it is not there. Both say what to do.
        """
        try:
            return await super().__aenter__()
        except aiomqtt.MqttError as error:
            refused = is_refusal(error) or is_refusal(error.__cause__)
            kind = AccessRefusedError if refused else aiomqtt.MqttError
            raise kind(reason_of(error, self._address, WORDING)) from error
