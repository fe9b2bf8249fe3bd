"""Why a broker did not let a client in, in words that say what to do."""

import socket
import ssl

import aiomqtt
from paho.mqtt.reasoncodes import ReasonCode

from clients.address import BrokerAddress

_NOT_AUTHORISED = (4, 5, 134, 135)
_BANNED = 138
# Of X.509, as OpenSSL numbers them.
_NOT_YET_VALID, _EXPIRED = 9, 10
_UNKNOWN_ISSUER = (2, 18, 19, 20, 21)
_WRONG_NAME = (62, 64)
_NO_TLS = "does it speak TLS on this port? Else correct the port, or use no TLS"
_SIGN = "have certificate_file signed by an authority that the broker knows"
# What OpenSSL says, in part, and what it means here.
_OF_TLS = (
    ("WRONG_VERSION_NUMBER", f"it answers without TLS; {_NO_TLS}"),
    ("RECORD_LAYER_FAILURE", f"it answers without TLS; {_NO_TLS}"),
    ("UNSUPPORTED_PROTOCOL", "it offers no TLS of version 1.2 or newer; update it"),
    ("PROTOCOL_VERSION", "it offers no TLS of version 1.2 or newer; update it"),
    (
        "CERTIFICATE_REQUIRED",
        "it wants a certificate of this client; give certificate_file and key_file",
    ),
    (
        "CERTIFICATE_EXPIRED",
        "it says that this client's certificate has expired; renew certificate_file",
    ),
    ("UNKNOWN_CA", f"it does not trust this client's certificate; {_SIGN}"),
    ("BAD_CERTIFICATE", f"it does not trust this client's certificate; {_SIGN}"),
    ("EOF occurred", "it cuts the connection; is certificate_file one that it trusts?"),
)


class SilentEndError(aiomqtt.MqttError):
    """The broker closed the connection before it had answered."""

    def __init__(self) -> None:
        super().__init__("it closes the connection without a word")


def reason_of(error: BaseException, address: BrokerAddress) -> str:
    """What went wrong with a connection, and what to do about it."""
    # aiomqtt puts what happened into a sentence of its own, and hides it.
    for one in (error, error.__cause__ or error.__context__):
        if reason := _known(one, address):
            return reason
    return str(error) or type(error).__name__


def _known(error: BaseException | None, address: BrokerAddress) -> str:
    """The words for an error; empty where there are none."""
    match error:
        case ssl.SSLError():
            text = _of_tls(error, address)
        case ConnectionRefusedError():
            text = "nothing listens there; start it, or correct its address"
        case socket.gaierror():
            text = "no such host; correct its address"
        case aiomqtt.MqttCodeError():
            text = _of_code(error, address)
        case ConnectionResetError() if address.tls:
            text = f"it cuts the connection; {_NO_TLS}"
        case SilentEndError() if not address.tls:
            text = f"{error}; does it want TLS? Then give mqtts:// before its name"
        case _:
            text = ""
    return text


def is_refusal(error: BaseException | None) -> bool:
    """Whether the broker does not want us, or we do not trust it: waiting is in vain.

    One that is just being ended cuts the line in the middle.
    """
    match error:
        case aiomqtt.MqttCodeError():
            return _code(error) in (*_NOT_AUTHORISED, _BANNED)
        case ssl.SSLEOFError() | ssl.SSLZeroReturnError():
            return False
    return isinstance(error, ssl.SSLError)


def _code(error: aiomqtt.MqttCodeError) -> int | None:
    return error.rc.value if isinstance(error.rc, ReasonCode) else error.rc


def _of_code(error: aiomqtt.MqttCodeError, address: BrokerAddress) -> str:
    code = _code(error)
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
        return "it knows no account for this client's certificate; see its accounts"
    return "it lets nobody in without an account; give username and password_file"


def _of_tls(error: ssl.SSLError, address: BrokerAddress) -> str:
    if isinstance(error, ssl.SSLCertVerificationError):
        return _of_certificate(error, address)
    reason = error.reason or str(error)
    if "HANDSHAKE_FAILURE" in reason and address.certificate_file is None:
        reason = "CERTIFICATE_REQUIRED"
    found = (text for mark, text in _OF_TLS if mark in reason)
    return next(found, f"TLS failed: {reason}")


def _of_certificate(error: ssl.SSLCertVerificationError, address: BrokerAddress) -> str:
    code, text = error.verify_code, error.verify_message
    if code in _WRONG_NAME:
        return (
            f"its certificate is not for {address.host!r} ({text}); give a name that "
            "stands in the certificate, or have it made anew"
        )
    if code == _EXPIRED:
        return "its certificate has expired, or this computer's clock is wrong"
    if code == _NOT_YET_VALID:
        return "its certificate is not valid yet, or this computer's clock is wrong"
    if code in _UNKNOWN_ISSUER:
        where = "ca_file" if address.ca_file else "the system's authorities"
        return (
            f"its certificate is signed by nobody in {where} ({text}); give the "
            "certificate of its authority as ca_file"
        )
    return f"its certificate cannot be trusted: {text}; have it made anew"
