"""Options of commands that serve a page to browsers."""

import socket
import ssl
from dataclasses import dataclass
from pathlib import Path
from socket import SOCK_STREAM
from typing import TYPE_CHECKING, Annotated

import typer

from traverse.cli.common.refusals import UNREACHABLE, end, refusals

if TYPE_CHECKING:
    from traverse.client.page.serving import Serving

LOOPBACK = ("127.0.0.1", "::1", "localhost")


@dataclass(frozen=True, slots=True, kw_only=True)
class PageOptions:
    """The options, in the order of `--help`.

    Attributes:
        host: Address to listen on; beyond this machine see below.
        port: Port to listen on.
        token_file: File with the token, 16 characters or more.
        certificate: Certificate of this page, PEM.
        key: Its key, PEM.
        show: Open a browser.
    """

    host: str = "127.0.0.1"
    port: Annotated[int, typer.Option(min=1, max=65535)] = 8080
    token_file: Path | None = None
    certificate: Path | None = None
    key: Path | None = None
    show: bool = False

    def serving(self) -> "Serving":
        """Their values; ends the command where they or their files are bad."""
        from traverse.broker.credentials import credential_file
        from traverse.client.page.access import read_token
        from traverse.client.page.serving import Serving

        beyond = self.host not in LOOPBACK
        if beyond and None in (self.token_file, self.certificate, self.key):
            raise typer.BadParameter(
                f"{self.host} can be reached from elsewhere: give --token-file, "
                "--certificate and --key, or listen on 127.0.0.1",
                param_hint="--host",
            )
        with refusals(ValueError):
            token_file, certificate, key = (
                None if file is None else credential_file(str(file))
                for file in (self.token_file, self.certificate, self.key)
            )
            token = None if token_file is None else read_token(token_file)
            if certificate is not None:
                _check_pair(certificate, key)
        _check_port(self.host, self.port)
        return Serving(
            host=self.host,
            port=self.port,
            token=token,
            certificate=certificate,
            key=key,
            show=self.show,
        )


def _check_port(host: str, port: int) -> None:
    """End the command where nobody can listen there, as another page may do."""
    try:
        (family, *_, place), *_ = socket.getaddrinfo(host, port, type=SOCK_STREAM)
        with socket.socket(family) as listener:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(place)
    except OSError as error:
        end(
            UNREACHABLE,
            f"{host}:{port} cannot be listened on: {error.strerror}; end the program "
            "that does, or choose another --port",
        )


def _check_pair(certificate: Path, key: Path | None) -> None:
    """Try a certificate; ValueError if it is invalid, or the key another one's."""
    from traverse.broker.credentials import load_pair

    try:
        load_pair(ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER), certificate, key)
    except ssl.SSLError as error:
        raise ValueError(
            f"{certificate} and {key or certificate}: {error.reason or 'no PEM'}; "
            "expected a certificate and its key without a passphrase, PEM"
        ) from error
