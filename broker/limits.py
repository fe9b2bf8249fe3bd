"""What a broker says in its answer to CONNECT (section 3.2.2.3)."""

from dataclasses import dataclass
from typing import Self

from traverse.broker.errors import MqttError
from traverse.broker.packets import MAX_LENGTH, Properties, Property


@dataclass(frozen=True, slots=True)
class BrokerLimits:
    """What may be sent to a broker; at first what is not limited.

    Attributes:
        receive_maximum: messages of QoS 1 without acknowledgement at any time.
        maximum_packet_bytes: length of a whole packet.
        keep_alive_s: longest silence that it takes.
    """

    receive_maximum: int = 65_535
    maximum_packet_bytes: int = MAX_LENGTH
    maximum_qos: int = 2
    retain_available: bool = True
    keep_alive_s: int = 65_535

    @classmethod
    def of(cls, properties: Properties) -> Self:
        """Read the limits from the properties of CONNACK.

        Raises:
            MqttError: nothing could be sent within them.
        """

        def number(identifier: Property, default: int) -> int:
            value = properties.get(identifier, default)
            return value if isinstance(value, int) else default

        limits = cls(
            number(Property.RECEIVE_MAXIMUM, 65_535),
            number(Property.MAXIMUM_PACKET_BYTES, MAX_LENGTH),
            number(Property.MAXIMUM_QOS, 2),
            bool(number(Property.RETAIN_AVAILABLE, 1)),
            number(Property.SERVER_KEEP_ALIVE_S, 0) or 65_535,
        )
        if not limits.receive_maximum or not limits.maximum_packet_bytes:
            raise MqttError(
                "it says that it takes no message (receive maximum or maximum packet "
                "size 0); correct its limits"
            )
        return limits
