"""Why there is no connection to the broker, in words that say what to do."""

import socket
import ssl

import aiomqtt
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.reasoncodes import ReasonCode

from daemon.broker_access import BrokerAddress
from daemon.broker_client import SilentEndError

_NO_TLS = "does it speak TLS on this port? Else correct port, or tls, of [broker]"
_SIGN = "have certificate_file signed by an authority that the broker knows"
_NOT_AUTHORISED = (4, 5, 134, 135)
_BANNED = (138,)
_END = PacketTypes.DISCONNECT
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
# Of X.509, as OpenSSL numbers them.
_NOT_YET_VALID, _EXPIRED, _REVOKED = 9, 10, 23
_UNKNOWN_ISSUER = (2, 18, 19, 20, 21)
_WRONG_NAME = (62, 64)
# What OpenSSL says, in part, and what it means here.
_OF_TLS = (
    ("WRONG_VERSION_NUMBER", f"it answers without TLS; {_NO_TLS}"),
    ("RECORD_LAYER_FAILURE", f"it answers without TLS; {_NO_TLS}"),
    ("UNSUPPORTED_PROTOCOL", "it offers no TLS of version 1.2 or newer"),
    ("PROTOCOL_VERSION", "it offers no TLS of version 1.2 or newer"),
    (
        "CERTIFICATE_REQUIRED",
        "it wants a certificate of this arm; give certificate_file and key_file in "
        "[broker]",
    ),
    (
        "CERTIFICATE_EXPIRED",
        "it says that this arm's certificate has expired; renew certificate_file",
    ),
    ("UNKNOWN_CA", f"it does not trust this arm's certificate; {_SIGN}"),
    ("BAD_CERTIFICATE", f"it does not trust this arm's certificate; {_SIGN}"),
)


def reason_of(error: BaseException, address: BrokerAddress) -> str:
    """What went wrong with a connection, for people."""
    cause = error.__cause__ or error.__context__  # aiomqtt hides it
    for one in (error, cause):
        match one:
            case ssl.SSLError():
                return _of_tls(one, address)
            case ConnectionRefusedError() | socket.gaierror():
                refused = isinstance(one, ConnectionRefusedError)
                return "nothing listens there" if refused else "no such host"
            case aiomqtt.MqttCodeError():
                return _of_code(one, address)
            case ConnectionResetError() if address.tls:
                return f"it cuts the connection; {_NO_TLS}"
            case SilentEndError() if not address.tls:
                return f"{one}; does it want TLS? Then set tls = true in [broker]"
    return str(error) or type(error).__name__


def _of_code(error: aiomqtt.MqttCodeError, address: BrokerAddress) -> str:
    code = error.rc.value if isinstance(error.rc, ReasonCode) else error.rc
    if code in _NOT_AUTHORISED:
        return f"not authorised: {_of_login(address)}"
    if code in _BANNED:
        return "the broker has banned this client; see its log"
    if isinstance(error.rc, ReasonCode) and error.rc.packetType == _END:
        return _OF_ENDS.get(error.rc.value, str(error))
    return str(error)


def _of_login(address: BrokerAddress) -> str:
    if address.username is not None:
        return (
            f"it refuses user {address.username!r} or the password; compare username "
            "and password_file of [broker] with the broker's accounts"
        )
    if address.certificate_file is not None:
        return "it knows no account for this arm's certificate; see its accounts"
    return "it lets nobody in without an account; give username and password_file"


def _of_certificate(error: ssl.SSLCertVerificationError, address: BrokerAddress) -> str:
    code, text = error.verify_code, error.verify_message
    if code in _WRONG_NAME:
        return (
            f"its certificate is not for {address.host!r} ({text}); give as host of "
            "[broker] a name that stands in the certificate, or have it made anew"
        )
    if code == _EXPIRED:
        return "its certificate has expired (or this computer's clock is wrong)"
    if code == _NOT_YET_VALID:
        return "its certificate is not valid yet, or this computer's clock is wrong"
    if code == _REVOKED:
        return "its certificate has been revoked"
    if code in _UNKNOWN_ISSUER:
        where = "ca_file of [broker]" if address.ca_file else "the system's authorities"
        return (
            f"its certificate is signed by nobody in {where} ({text}); put the "
            "certificate of its authority into ca_file"
        )
    return f"its certificate cannot be trusted: {text}"


def _of_tls(error: ssl.SSLError, address: BrokerAddress) -> str:
    if isinstance(error, ssl.SSLCertVerificationError):
        return _of_certificate(error, address)
    reason = error.reason or str(error)
    if "HANDSHAKE_FAILURE" in reason and address.certificate_file is None:
        reason = "CERTIFICATE_REQUIRED"
    for mark, text in _OF_TLS:
        if mark in reason:
            return text
    return f"TLS failed: {reason}"
