"""Why the daemon has no connection to the broker, in words that say what to do."""

import aiomqtt
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.reasoncodes import ReasonCode

from traverse.broker.reasons import Wording
from traverse.broker.reasons import reason_of as reason_of_entrance
from traverse.daemon.mqtt.credentials import BrokerAddress

WORDING = Wording(
    who="this arm",
    where=" of [broker]",
    use_tls="set tls = true in [broker]",
    absent="",  # an event has its remedy beside it
)
# Why a connection that was there has ended; paho says 128 where it was just cut.
_OF_ENDS = {
    128: "the connection was cut; the broker has ended, or the network between",
    137: "the broker is too busy",
    139: "the broker is shutting down",
    141: "nothing was heard of the other side for longer than keepalive_s of [broker]",
    142: "somebody else came with this arm's client id; is there a second daemon of "
    "this name?",
    152: "somebody has ended the connection at the broker",
}


def reason_of(error: BaseException, address: BrokerAddress) -> str:
    """What went wrong with a connection, for people."""
    for one in (error, error.__cause__ or error.__context__):
        match one:
            case aiomqtt.MqttCodeError(rc=ReasonCode(packetType=of, value=code)):
                if of == PacketTypes.DISCONNECT and code in _OF_ENDS:
                    return _OF_ENDS[code]
    return reason_of_entrance(error, address, WORDING)
