"""Properties of MQTT 5 that the daemon's packets carry."""

from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from traverse.protocol.encoding import Encoding, content_type

RECEIVE_MAXIMUM = 32  # commands of QoS 1 on their way to us


class CachedProperties(Properties):
    """What every message in one encoding carries; packed once, since that is slow.

    Args:
        encoding: of the payloads.
    """

    def __init__(self, encoding: Encoding) -> None:
        super().__init__(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]  # paho's is not typed
        self.ContentType = content_type(encoding)
        # Past paho's own attributes, which are properties of MQTT.
        packed = super().pack()  # type: ignore[no-untyped-call]  # paho's is not typed
        object.__setattr__(self, "_packed", packed)

    def pack(self) -> bytes:
        """As they go into a packet."""
        packed: bytes = object.__getattribute__(self, "_packed")
        return packed


def publish_properties(encoding: Encoding) -> Properties:
    """What a message carries, to which more can be added."""
    properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]  # paho's is not typed
    properties.ContentType = content_type(encoding)
    return properties


def connect_properties(max_packet_bytes: int) -> Properties:
    """What we are ready to take in: longer packets the broker must not send."""
    properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]  # paho's is not typed
    properties.MaximumPacketSize = max_packet_bytes
    properties.ReceiveMaximum = RECEIVE_MAXIMUM
    return properties
