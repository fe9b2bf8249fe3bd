"""The reason of a lost connection is reported in sentences."""

import pytest

from traverse.broker.address import BrokerAddress
from traverse.broker.errors import DisconnectedError
from traverse.broker.reasons import reason_of
from traverse.daemon.mqtt.wording import WORDING

ADDRESS = BrokerAddress("arms.example", 1883)


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (0x89, "too busy"),
        (0x8B, "shutting down"),
        (0x8D, "keepalive_s of [broker]"),
        (0x8E, "another client connected with the id of this arm"),
        (0x95, "mosquitto: max_packet_size"),
        (0x97, "quota"),
        (0x98, "at the broker"),
        (0x9A, "retain_available true"),
    ],
)
def test_an_end_is_reported_with_a_remedy(code, words):
    assert words in reason_of(DisconnectedError(code), ADDRESS, WORDING)
