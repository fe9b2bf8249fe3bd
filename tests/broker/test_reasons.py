"""Errors of broker, OpenSSL and network are reported in sentences.

A visitor of brokers that do not do what brokers do.
Every line to a broker is checked.
"""

import errno
import socket
import ssl
from dataclasses import dataclass

import pytest

from tests.certificates import Authority
from traverse.broker.credentials import tls_context
from traverse.broker.errors import (
    ClosedBeforeAnswerError,
    ConnectionCutError,
    ConnectRefusedError,
    DisconnectedError,
    MqttError,
    RefusedError,
)
from traverse.broker.reasons import Wording, is_refusal, reason_of, sentence

WORDING = Wording("this visitor", " of [door]", "speak TLS", "; look elsewhere")


@dataclass(frozen=True, slots=True)
class Door:
    host: str = "arms.example"
    username: str | None = None
    tls: bool = True
    ca_file: str | None = None
    certificate_file: str | None = None


def reason(error, **door):
    return reason_of(error, Door(**door), WORDING)


def refused_with(code, text=""):
    return ConnectRefusedError(code, text)


def error_of_openssl(answer):
    """What a handshake ends with when a broker answers this, and no more."""
    incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
    line = tls_context(None).wrap_bio(incoming, outgoing, server_hostname="a")
    with pytest.raises(ssl.SSLWantReadError):
        line.do_handshake()
    incoming.write(answer)
    incoming.write_eof()
    with pytest.raises(ssl.SSLError) as caught:
        line.do_handshake()
    return caught.value


def alert(number):
    return bytes((21, 3, 3, 0, 2, 2, number))


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (b"HTTP/1.1 400 Bad Request\r\n", "answers without TLS"),
        (alert(70), "no TLS of version 1.2 or newer; update it"),
        (alert(116), "certificate of this visitor; give certificate_file and key_file"),
        (alert(116), "key_file of [door]"),
        (alert(40), "requires a certificate of this visitor"),
        (alert(45), "this visitor's certificate has expired; renew"),
        (alert(44), "this visitor's certificate has been revoked; renew"),
        (alert(48), "does not trust this visitor's certificate; have"),
        (alert(42), "does not trust this visitor's certificate; have"),
        (b"", "it cuts the connection; does it require a certificate_file"),
    ],
)
def test_what_openssl_says_is_reported_in_a_sentence(answer, words):
    error = error_of_openssl(answer)
    assert words in reason(error)
    assert is_refusal(error) == (answer != b"")


@pytest.mark.parametrize("kind", [ssl.SSLEOFError, ssl.SSLZeroReturnError])
def test_a_cut_line_is_known_by_its_kind_not_by_words_that_pythons_change(kind):
    error = kind(8, "TLS/SSL connection has been closed (EOF) (_ssl.c:992)")
    assert "does it require a certificate_file" in reason(error)
    assert not is_refusal(error)


def test_who_showed_a_certificate_in_vain_is_not_asked_for_one():
    text = reason(error_of_openssl(alert(40)), certificate_file="arm.crt")
    assert text == "TLS failed: SSLV3_ALERT_HANDSHAKE_FAILURE"


@pytest.mark.parametrize("code", [4, 5])
@pytest.mark.parametrize(
    ("door", "words"),
    [
        ({"username": "arm", "certificate_file": "a"}, "user 'arm' or the password"),
        ({"certificate_file": "a"}, "no account for this visitor's certificate"),
        ({}, "give username and password_file of [door]"),
    ],
)
def test_a_refused_account_is_reported_with_what_was_shown(code, door, words):
    # of MQTT 3.1.1, and the same of MQTT 5
    for error in (refused_with(code), refused_with(code + 130)):
        assert words in reason(error, **door)
        assert is_refusal(error)


def test_a_connection_that_is_gone_was_cut():
    assert reason(ConnectionCutError()).startswith("the connection was cut")


def test_a_ban_is_a_refusal():
    assert "banned" in reason(refused_with(138))
    assert is_refusal(refused_with(138))


# All that say no in the standard's table of reason codes (MQTT 5, section 2.4), but
# those of packets that are not spoken: QoS 2 and re-authentication.
REFUSING = [
    *range(0x80, 0x8F),
    *(0x8F, 0x90, 0x91, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9A, 0x9B),
    *range(0x9C, 0xA3),
]


@pytest.mark.parametrize("kind", [ConnectRefusedError, DisconnectedError, RefusedError])
def test_every_reason_code_has_a_sentence_and_a_remedy(kind):
    for code in (1, 2, 3, 4, 5, *REFUSING):
        text = reason(kind(code))
        assert "reason code" not in text
        assert "{" not in text
        assert len(text.split()) >= 3


def test_so_has_every_code_of_an_acknowledgement():
    for code in REFUSING:
        text = sentence(code, WORDING)
        assert "reason code" not in text
        assert "{" not in text


def test_what_the_broker_says_itself_is_quoted():
    assert reason(refused_with(0x83, "no more arms")).endswith("it says 'no more arms'")
    assert "0xf3" in sentence(0xF3, WORDING)
    assert not is_refusal(refused_with(0x88))


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ConnectionRefusedError(), "nothing listens there; look elsewhere"),
        (socket.gaierror(), "no such host; look elsewhere"),
        (TimeoutError(), "no answer; look elsewhere"),
        (OSError(errno.EHOSTUNREACH, "x"), "no way there through the network; look"),
        (ConnectionResetError(), "does it speak TLS on this port?"),
    ],
)
def test_what_the_network_says_is_found_behind_the_client_s_error(error, words):
    hidden = MqttError("something with numbers")
    hidden.__cause__ = error
    assert words in reason(hidden)
    assert not is_refusal(error)


def test_a_silent_end_may_mean_that_tls_is_required():
    assert "does it require TLS? Then speak TLS" in reason(
        ClosedBeforeAnswerError(), tls=False
    )
    assert (
        reason(ClosedBeforeAnswerError()) == "it closes the connection without a word"
    )


def test_what_nobody_foresaw_is_reported_as_it_is():
    assert reason(MqttError("something else")) == "something else"
    assert reason(ValueError()) == "ValueError"


@pytest.mark.needs("openssl")
def test_the_broker_is_checked_against_a_file_and_the_line_is_new_enough(tmp_path):
    context = tls_context(Authority(tmp_path).certificate)
    assert context.verify_mode is ssl.CERT_REQUIRED
    assert context.check_hostname
    assert context.minimum_version is ssl.TLSVersion.TLSv1_2
    assert [certificate["subject"] for certificate in context.get_ca_certs()] == [
        ((("commonName", "authority"),),)
    ]


def test_without_a_file_the_authorities_are_those_of_the_system():
    context = tls_context(None)
    assert context.verify_mode is ssl.CERT_REQUIRED
    assert context.check_hostname
