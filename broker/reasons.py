"""Why there is no connection to a broker, in words that say what to do."""

import errno
import socket
import ssl
from dataclasses import dataclass

import aiomqtt
from paho.mqtt.enums import MQTTErrorCode
from paho.mqtt.reasoncodes import ReasonCode

from traverse.broker.address import BrokerAddress
from traverse.broker.diagnosing_client import ConnectionClosedError

_NOT_AUTHORISED = (4, 5, 134, 135)
_BANNED = 138
# Of X.509, as OpenSSL numbers them.
_NOT_YET_VALID, _EXPIRED = 9, 10
_UNKNOWN_ISSUER = (2, 18, 19, 20, 21)
_WRONG_NAME = (62, 64)
_NO_WAY = (errno.EHOSTUNREACH, errno.ENETUNREACH, errno.ENETDOWN)
_NO_TLS = "does it speak TLS on this port? Else correct the port, or use no TLS"
_SIGN = "have certificate_file signed by an authority that the broker knows"
_RENEW = "renew certificate_file"
# Parts of OpenSSL's messages, and their meaning for a client and its settings.
_OF_TLS = (
    ("WRONG_VERSION_NUMBER", f"it answers without TLS; {_NO_TLS}"),
    ("RECORD_LAYER_FAILURE", f"it answers without TLS; {_NO_TLS}"),
    ("UNSUPPORTED_PROTOCOL", "it offers no TLS of version 1.2 or newer; update it"),
    ("PROTOCOL_VERSION", "it offers no TLS of version 1.2 or newer; update it"),
    (
        "CERTIFICATE_REQUIRED",
        "it requires a certificate of {who}; give certificate_file and key_file{where}",
    ),
    (
        "CERTIFICATE_EXPIRED",
        f"it says that {{who}}'s certificate has expired; {_RENEW}",
    ),
    (
        "CERTIFICATE_REVOKED",
        f"it says that {{who}}'s certificate has been revoked; {_RENEW}",
    ),
    ("UNKNOWN_CA", f"it does not trust {{who}}'s certificate; {_SIGN}"),
    ("BAD_CERTIFICATE", f"it does not trust {{who}}'s certificate; {_SIGN}"),
)
_LOST = (MQTTErrorCode.MQTT_ERR_NO_CONN, MQTTErrorCode.MQTT_ERR_CONN_LOST)
CUT_OFF = "the connection was cut; the broker has ended, or the network between"
_CUT = "it cuts the connection; does it require a certificate_file that it trusts?"


@dataclass(frozen=True, slots=True)
class Wording:
    """Words of the messages for one kind of client.

    Attributes:
        who: the client ("this arm").
        where: the place of its settings, after the name of one (" of [broker]").
        use_tls: what to do for TLS.
        absent: what to do where no broker is found, after what was found instead.
    """

    who: str
    where: str
    use_tls: str
    absent: str


def reason_of(error: BaseException, address: BrokerAddress, wording: Wording) -> str:
    """Reason for a failed connection, and its remedy."""
    # aiomqtt puts what happened into a sentence of its own, and hides it.
    for one in (error, error.__cause__ or error.__context__):
        if reason := _known(one, address, wording):
            return reason
    return str(error) or type(error).__name__


def reason_code(error: aiomqtt.MqttCodeError) -> int | None:
    """The reason code of a broker, of MQTT 5 or 3.1.1.

    None where the library uses one of its own, which may be the same number.
    """
    if isinstance(error.rc, MQTTErrorCode):
        return None
    return error.rc.value if isinstance(error.rc, ReasonCode) else error.rc


def is_refusal(error: BaseException | None) -> bool:
    """Whether the broker refuses us, or is not trusted: waiting is in vain.

    One that is just being ended cuts the line in the middle.
    """
    match error:
        case aiomqtt.MqttCodeError():
            return reason_code(error) in (*_NOT_AUTHORISED, _BANNED)
        case ssl.SSLEOFError() | ssl.SSLZeroReturnError():
            return False
    return isinstance(error, ssl.SSLError)


def _known(
    error: BaseException | None, address: BrokerAddress, wording: Wording
) -> str:
    """The words for an error; empty where there are none."""
    match error:
        case ssl.SSLCertVerificationError():
            text = _of_certificate(error, address, wording)
        case ssl.SSLEOFError() | ssl.SSLZeroReturnError():
            text = _CUT  # each Python and OpenSSL words it differently
        case ssl.SSLError():
            text = _of_tls(error, address, wording)
        case ConnectionRefusedError():
            text = f"nothing listens there{wording.absent}"
        case socket.gaierror():
            text = f"no such host{wording.absent}"
        case TimeoutError():
            text = f"no answer{wording.absent}"
        case OSError() if error.errno in _NO_WAY:
            text = f"no way there through the network{wording.absent}"
        case aiomqtt.MqttCodeError():
            text = _of_code(error, address, wording)
        case ConnectionResetError() if address.tls:
            text = f"it cuts the connection; {_NO_TLS}"
        case ConnectionClosedError() if not address.tls:
            text = f"{error}; does it require TLS? Then {wording.use_tls}"
        case _:
            text = ""
    return text


def _of_code(
    error: aiomqtt.MqttCodeError, address: BrokerAddress, wording: Wording
) -> str:
    if isinstance(error.rc, MQTTErrorCode) and error.rc in _LOST:
        return CUT_OFF
    code = reason_code(error)
    if code == _BANNED:
        return "it has banned this client; see its log"
    if code not in _NOT_AUTHORISED:
        return str(error)
    if address.username is not None:
        return (
            f"it refuses user {address.username!r} or the password; compare them with "
            "its accounts"
        )
    if address.certificate_file is not None:
        return f"it knows no account for {wording.who}'s certificate; see its accounts"
    return (
        "it refuses clients without an account; give username and "
        f"password_file{wording.where}"
    )


def _of_tls(error: ssl.SSLError, address: BrokerAddress, wording: Wording) -> str:
    reason = error.reason or str(error)
    if "HANDSHAKE_FAILURE" in reason and address.certificate_file is None:
        reason = "CERTIFICATE_REQUIRED"
    for mark, text in _OF_TLS:
        if mark in reason:
            return text.format(who=wording.who, where=wording.where)
    return f"TLS failed: {reason}"


def _of_certificate(
    error: ssl.SSLCertVerificationError, address: BrokerAddress, wording: Wording
) -> str:
    code, text = error.verify_code, error.verify_message
    if code in _WRONG_NAME:
        return (
            f"its certificate is not for {address.host!r} ({text}); use a name that "
            "is in the certificate, or renew the certificate"
        )
    if code == _EXPIRED:
        return "its certificate has expired, or this computer's clock is wrong"
    if code == _NOT_YET_VALID:
        return "its certificate is not valid yet, or this computer's clock is wrong"
    if code in _UNKNOWN_ISSUER:
        file = f"ca_file{wording.where}"
        signers = "the system's authorities" if address.ca_file is None else file
        return (
            f"its certificate is not signed by any of {signers} ({text}); give the "
            f"certificate of its authority as {file}"
        )
    return f"its certificate cannot be trusted: {text}; have it made anew"
