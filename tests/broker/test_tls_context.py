"""Every line to a broker is checked."""

import socket
import ssl

import pytest

from tests.certificates import Authority
from traverse.broker.credentials import tls_context


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
