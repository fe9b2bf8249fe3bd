"""Reasons why there is no connection to a broker, with remedies."""

import errno
import socket
import ssl
from dataclasses import dataclass

from traverse.broker.address import BrokerAddress
from traverse.broker.errors import (
    ClosedBeforeAnswerError,
    ConnectionCutError,
    ConnectRefusedError,
    RefusedError,
)

_NOT_AUTHORISED = (4, 5, 0x86, 0x87)
_BANNED = 0x8A
VERSION_REFUSED = (1, 0x84)
"""Reason codes of an unsupported version of MQTT."""
_ITS_LOG = "its log has the reason"
_SENTENCES = {
    # Return codes of MQTT 3.1.1, section 3.2.2.3.
    1: "it speaks neither MQTT 5 nor 3.1.1; update it",
    2: "it does not accept the client id; allow ids of 65 characters there",
    3: "it is not available now; {log}",
    # Reason codes of MQTT 5, section 2.4.
    0x80: "it refuses without saying why; {log}",
    0x81: "it could not read a packet; {log}, and it may be a fault of ours: report it",
    0x82: "it takes a packet for a violation of MQTT; {log}, and it may be a fault of "
    "ours: report it",
    0x83: "it refuses for reasons of its own; {log}",
    0x84: "it speaks neither MQTT 5 nor 3.1.1; update it",
    0x85: "it does not accept the client id; allow ids of 65 characters there",
    0x86: "it does not accept the user or the password; compare them with its accounts",
    0x87: "its access list does not allow that; allow it for the account of {who}",
    0x88: "it is not available now; {log}",
    0x89: "the broker is too busy",
    0x8A: "it has banned this client; see its log",
    0x8B: "the broker is shutting down",
    0x8C: "it requires a way of authentication that is not spoken here; let it accept "
    "a user with a password, or a certificate",
    0x8D: "nothing was received for longer than keepalive_s{where}",
    0x8E: "another client connected with the id of {who}; is there a second program of "
    "this name?",
    0x8F: "it does not accept a topic filter; see its access list",
    0x90: "it does not accept the topic; see its rules for topics",
    0x91: "it takes a packet identifier for one that is in use; {log}",
    0x92: "it does not know a packet identifier; {log}",
    0x93: "it was sent more messages at once than it takes; report this, it is a fault "
    "of ours",
    0x94: "it does not know a topic alias; report this, it is a fault of ours",
    0x95: "a message was longer than it takes; raise its limit (mosquitto: "
    "max_packet_size)",
    0x96: "messages arrive there faster than it allows; raise its limit, or lower "
    "live_rate_hz of [capture]",
    0x97: "its quota is used up; raise the quota of this client there",
    0x98: "the connection was ended at the broker",
    0x99: "it does not accept the format of the payload; see its rules for messages",
    0x9A: "it keeps no retained messages, and without them nobody learns the state of "
    "an arm; allow them (mosquitto: retain_available true)",
    0x9B: "it takes messages of quality of service 0 only, which may be lost; allow 1 "
    "(mosquitto: max_qos 1)",
    0x9C: "it says to use another broker; correct host{where}",
    0x9D: "it has moved; correct host{where}",
    0x9E: "it has no shared subscriptions; allow them, or use another broker",
    0x9F: "clients connect faster than it allows; raise its limit of connections",
    0xA0: "it ends connections that last long; raise its limit of time",
    0xA1: "it has no subscription identifiers; report this, it is a fault of ours",
    0xA2: "it accepts no wildcards in topic filters; allow them, commands need them",
}
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
_CUT = "it cuts the connection; does it require a certificate_file that it trusts?"


@dataclass(frozen=True, slots=True)
class Wording:
    """Words of the messages for one kind of client.

    Attributes:
        who: the client ("this arm").
        where: the place of its settings, after the name of one (" of [broker]").
        use_tls: remedy for missing TLS.
        absent: remedy if no broker is found, after what was found instead.
    """

    who: str
    where: str
    use_tls: str
    absent: str


def reason_of(error: BaseException, address: BrokerAddress, wording: Wording) -> str:
    """Return the reason for a failed or lost connection, and its remedy."""
    for known in (error, error.__cause__):
        if reason := _known(known, address, wording):
            return reason
    return str(error) or type(error).__name__


def sentence(code: int, wording: Wording, text: str = "") -> str:
    """Return the meaning of a broker's reason code, and the remedy.

    Args:
        code: of MQTT 5, or a return code of MQTT 3.1.1.
        wording: of the client.
        text: of the broker.
    """
    words = _SENTENCES.get(code, "it refuses with reason code {code:#04x}; {log}")
    log = f"it says {text!r}" if text else _ITS_LOG
    return words.format(code=code, log=log, who=wording.who, where=wording.where)


def is_refusal(error: BaseException | None) -> bool:
    """Return whether the broker refuses us, or is not trusted, so that waiting is vain.

    A broker that is being stopped cuts the connection in the middle.
    """
    match error:
        case ConnectRefusedError():
            return error.code in (*_NOT_AUTHORISED, _BANNED)
        case ssl.SSLEOFError() | ssl.SSLZeroReturnError():
            return False
    return isinstance(error, ssl.SSLError)


def _known(
    error: BaseException | None, address: BrokerAddress, wording: Wording
) -> str:
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
        case RefusedError():
            text = _of_code(error, address, wording)
        case ConnectionResetError() if address.tls:
            text = f"it cuts the connection; {_NO_TLS}"
        case ClosedBeforeAnswerError() if not address.tls:
            text = f"{error}; does it require TLS? Then {wording.use_tls}"
        case ConnectionCutError() if error.__cause__ is None:
            text = str(error)
        case _:
            text = ""
    return text


def _of_code(error: RefusedError, address: BrokerAddress, wording: Wording) -> str:
    if error.code not in _NOT_AUTHORISED:
        return sentence(error.code, wording, error.text)
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
        return (
            "its certificate has expired, or this computer's clock is wrong; renew the "
            "broker's certificate, or set the clock"
        )
    if code == _NOT_YET_VALID:
        return (
            "its certificate is not valid yet, or this computer's clock is wrong; set "
            "the clock"
        )
    if code in _UNKNOWN_ISSUER:
        file = f"ca_file{wording.where}"
        signers = "the system's authorities" if address.ca_file is None else file
        return (
            f"its certificate is not signed by any of {signers} ({text}); give the "
            f"certificate of its authority as {file}"
        )
    return f"its certificate cannot be trusted: {text}; have it made anew"
