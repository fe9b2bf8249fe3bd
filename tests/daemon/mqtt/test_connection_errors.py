"""The reason of a lost connection is reported in sentences."""

import aiomqtt
import pytest
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.reasoncodes import ReasonCode

from traverse.broker.address import BrokerAddress
from traverse.daemon.mqtt.connection import reason_of

ADDRESS = BrokerAddress("arms.example", 1883)


def ended(code):
    reason = ReasonCode(PacketTypes.DISCONNECT, identifier=code)
    error = aiomqtt.MqttError("the connection was lost")
    error.__cause__ = aiomqtt.MqttCodeError(reason)
    return reason_of(error, ADDRESS)


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (128, "the connection was cut"),
        (137, "too busy"),
        (139, "shutting down"),
        (141, "keepalive_s of [broker]"),
        (142, "second daemon"),
        (152, "at the broker"),
    ],
)
def test_an_end_is_reported_without_a_code(code, words):
    text = ended(code)

    assert words in text
    assert "code:" not in text


def test_a_code_that_says_enough_stays():
    assert ended(149) == "[code:149] Packet too large"


def test_an_unknown_error_at_the_entrance_is_no_cut():
    refused = ReasonCode(PacketTypes.CONNACK, identifier=128)

    text = reason_of(aiomqtt.MqttCodeError(refused), ADDRESS)

    assert text == "[code:128] Unspecified error"
