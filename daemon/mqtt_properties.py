"""Properties of MQTT 5 that the daemon's packets carry."""

from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from protocol.encoding import Encoding, content_type

MAX_UNANSWERED = 32  # commands of QoS 1 on their way to us


def publish_properties(encoding: Encoding, correlation: bytes | None = None) -> bytes:
    """What every message carries, packed; to be kept, since packing is slow.

    Args:
        encoding: of the payload.
        correlation: of what the message answers.
    """
    properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]  # paho's is not typed
    properties.ContentType = content_type(encoding)
    if correlation is not None:
        properties.CorrelationData = correlation
    return bytes(properties.pack())  # type: ignore[no-untyped-call]  # paho's is not typed


def connect_properties(max_packet_bytes: int) -> Properties:
    """What we are ready to take in: longer packets the broker must not send."""
    properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]  # paho's is not typed
    properties.MaximumPacketSize = max_packet_bytes
    properties.ReceiveMaximum = MAX_UNANSWERED
    return properties
