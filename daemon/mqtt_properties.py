"""Properties of MQTT 5 that the daemon's packets carry."""

from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from protocol.encoding import Encoding, content_type

MAX_UNANSWERED = 32  # commands of QoS 1 on their way to us


def publish_properties(encoding: Encoding) -> Properties:
    """What every message carries; one of them serves all, since making it is slow."""
    properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]  # paho's is not typed
    properties.ContentType = content_type(encoding)
    return properties


def connect_properties(max_packet_bytes: int) -> Properties:
    """What we are ready to take in: longer packets the broker must not send."""
    properties = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]  # paho's is not typed
    properties.MaximumPacketSize = max_packet_bytes
    properties.ReceiveMaximum = MAX_UNANSWERED
    return properties
