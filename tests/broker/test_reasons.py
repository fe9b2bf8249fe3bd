"""Errors of broker, OpenSSL and network are reported in sentences.

A visitor of brokers that do not do what brokers do.
Every line to a broker is checked.
"""

import asyncio
import contextlib
import errno
import socket
import ssl
from dataclasses import dataclass

import aiomqtt
import pytest
from paho.mqtt.enums import MQTTErrorCode
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.reasoncodes import ReasonCode

from tests.certificates import Authority
from traverse.broker.credentials import tls_context
from traverse.broker.diagnosing_client import ConnectionClosedError, DiagnosingClient
from traverse.broker.reasons import Wording, is_refusal, reason_of

WORDING = Wording("this visitor", " of [door]", "speak TLS", "; look elsewhere")


@dataclass(frozen=True, slots=True)
class Door:
    """An address as the reasons want to see it."""

    host: str = "arms.example"
    username: str | None = None
    tls: bool = True
    ca_file: str | None = None
    certificate_file: str | None = None


def told(error, **door):
    return reason_of(error, Door(**door), WORDING)


def refused_with(code, packet=PacketTypes.CONNACK):
    return aiomqtt.MqttCodeError(ReasonCode(packet, identifier=code))


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
    """A fatal alert of TLS 1.2."""
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
    assert words in told(error)
    assert is_refusal(error) == (answer != b"")


@pytest.mark.parametrize("kind", [ssl.SSLEOFError, ssl.SSLZeroReturnError])
def test_a_cut_line_is_known_by_its_kind_not_by_words_that_pythons_change(kind):
    error = kind(8, "TLS/SSL connection has been closed (EOF) (_ssl.c:992)")
    assert "does it require a certificate_file" in told(error)
    assert not is_refusal(error)


def test_who_showed_a_certificate_in_vain_is_not_asked_for_one():
    text = told(error_of_openssl(alert(40)), certificate_file="arm.crt")
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
    for error in (aiomqtt.MqttCodeError(code), refused_with(code + 130)):
        assert words in told(error, **door)
        assert is_refusal(error)


@pytest.mark.parametrize("code", MQTTErrorCode)
def test_a_code_of_the_library_is_none_of_the_protocol(code):
    """They share numbers: 4 is a lost connection there, and a bad password here."""
    error = aiomqtt.MqttCodeError(code, "could not publish")
    assert "account" not in told(error)
    assert "banned" not in told(error)
    assert not is_refusal(error)


def test_a_connection_that_is_gone_was_cut():
    for code in (MQTTErrorCode.MQTT_ERR_NO_CONN, MQTTErrorCode.MQTT_ERR_CONN_LOST):
        assert told(aiomqtt.MqttCodeError(code)).startswith("the connection was cut")


def test_a_ban_is_a_refusal():
    assert "banned" in told(refused_with(138))
    assert is_refusal(refused_with(138))


def test_a_code_that_says_enough_stays():
    assert told(refused_with(136)) == "[code:136] Server unavailable"
    assert not is_refusal(refused_with(136))


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
def test_what_the_network_says_is_found_behind_aiomqtts_sentence(error, words):
    hidden = aiomqtt.MqttError("something with numbers")
    hidden.__context__ = error
    assert words in told(hidden)
    assert not is_refusal(error)


def test_a_silent_end_may_mean_that_tls_is_required():
    assert "does it require TLS? Then speak TLS" in told(
        ConnectionClosedError(), tls=False
    )
    assert told(ConnectionClosedError()) == "it closes the connection without a word"


def test_what_nobody_foresaw_is_reported_as_it_is():
    assert told(aiomqtt.MqttError("something else")) == "something else"
    assert told(ValueError()) == "ValueError"


HOST = "127.0.0.1"


@contextlib.asynccontextmanager
async def door(meet):
    """Start a listener; return the port."""
    server = await asyncio.start_server(meet, HOST, 0)
    async with server:
        yield server.sockets[0].getsockname()[1]


async def test_an_end_without_an_answer_is_reported_at_once():
    async def close(reader, writer):
        await reader.read(1)
        writer.close()

    async with door(close) as port:
        with pytest.raises(ConnectionClosedError):
            await DiagnosingClient(HOST, port).__aenter__()


async def test_who_does_not_wait_for_the_answer_leaves():
    came, left = asyncio.Event(), asyncio.Event()

    async def be_silent(reader, writer):
        await reader.readexactly(1)
        came.set()
        await reader.read()  # up to the end
        left.set()
        writer.close()

    async with door(be_silent) as port:
        visit = asyncio.create_task(DiagnosingClient(HOST, port).__aenter__())
        await came.wait()
        visit.cancel()
        with pytest.raises(asyncio.CancelledError):
            await visit
        async with asyncio.timeout(10):
            await left.wait()


async def test_a_cancellation_as_the_work_ends_is_not_forgotten():
    work = asyncio.get_running_loop().create_future()
    waiting = asyncio.create_task(DiagnosingClient("nowhere")._wait_for(work, None))
    await asyncio.sleep(0)
    work.set_result("done")
    waiting.cancel()
    with pytest.raises(asyncio.CancelledError):
        await waiting


async def test_work_that_takes_too_long_is_given_up():
    work = asyncio.get_running_loop().create_future()
    with pytest.raises(aiomqtt.MqttError, match="timed out"):
        await DiagnosingClient("nowhere")._wait_for(work, 0.01)
    assert work.cancelled()


@pytest.mark.needs("openssl")
def test_the_broker_is_checked_against_a_file_and_the_line_is_new_enough(tmp_path):
    context = tls_context(Authority(tmp_path).certificate)
    assert context.verify_mode is ssl.CERT_REQUIRED
    assert context.check_hostname
    assert context.minimum_version is ssl.TLSVersion.TLSv1_2
    assert [one["subject"] for one in context.get_ca_certs()] == [
        ((("commonName", "authority"),),)
    ]


def test_without_a_file_the_authorities_are_those_of_the_system():
    context = tls_context(None)
    assert context.verify_mode is ssl.CERT_REQUIRED
    assert context.check_hostname


def test_a_handshake_that_fails_leaves_no_socket_open():
    ours, theirs = socket.socketpair()
    with theirs:
        theirs.sendall(b"HTTP/1.1 400 Bad Request\r\n")
        line = tls_context(None).wrap_socket(
            ours, server_hostname="a", do_handshake_on_connect=False
        )
        with pytest.raises(ssl.SSLError):
            line.do_handshake()
        assert line.fileno() == -1
