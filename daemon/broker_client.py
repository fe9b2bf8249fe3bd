"""An MQTT client that hears when the broker refuses a message.

aiomqtt 2.5 takes every PUBACK for a yes; with MQTT 5 its reason code may say no, for
example where an access list forbids the topic. Brokers of MQTT 3.1.1 cannot say no.
"""

from typing import Any

import aiomqtt
from paho.mqtt.client import Client as PahoClient
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode


class BrokerClient(aiomqtt.Client):
    """A client whose messages are published one after the other."""

    _refusal: str | None = None

    def take_refusal(self) -> str | None:
        """Why the broker refused the message just published; None: it has it."""
        refusal, self._refusal = self._refusal, None
        return refusal

    def _on_publish(
        self,
        client: PahoClient,
        userdata: Any,  # noqa: ANN401 - as aiomqtt declares it
        mid: int,
        reason_code: ReasonCode,
        properties: Properties,
    ) -> None:
        if reason_code.is_failure:
            self._refusal = str(reason_code)
        super()._on_publish(client, userdata, mid, reason_code, properties)
