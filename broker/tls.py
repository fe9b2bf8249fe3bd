"""TLS as this project speaks it: the broker's certificate and name are checked."""

import ssl
from collections.abc import Callable
from pathlib import Path

from traverse.strict_toml.files import bytes_of


class _Line(ssl.SSLSocket):
    """Closed when its handshake fails; paho would leave it open."""

    def do_handshake(self, block: bool = False) -> None:
        try:
            super().do_handshake(block)
        except BaseException:
            self.close()
            raise


def tls_context(ca_file: Path | None) -> ssl.SSLContext:
    """How the line to a broker is encrypted; without a certificate of our own.

    Its certificate is signed by one of ``ca_file``, or by the system's.

    Raises:
        OSError: the file cannot be read, or holds no certificate.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.sslsocket_class = _Line
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    if ca_file is None:
        context.load_default_certs(ssl.Purpose.SERVER_AUTH)
    else:
        bytes_of(ca_file)  # OpenSSL would wait for a pipe
        context.load_verify_locations(ca_file)
    return context


def load_pair(
    context: ssl.SSLContext,
    certificate: Path,
    key: Path | None,
    passphrase: Callable[[], str] = str,
) -> None:
    """Use a certificate and its key, PEM, which may be in the same file.

    The passphrase is asked for an encrypted key; OpenSSL would prompt at the terminal.

    Raises:
        OSError: a file cannot be read, or they are no pair.
    """
    for file in (certificate, key or certificate):
        bytes_of(file)
    context.load_cert_chain(certificate, key, passphrase)
