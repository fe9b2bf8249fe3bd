"""Where the broker is and how to get in."""

import ssl
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self
from urllib.parse import urlsplit

from traverse.broker.tls import load_pair, tls_context
from traverse.strict_toml.files import text_of

PORT = 1883
TLS_PORT = 8883
SCHEMES = {"mqtt": False, "mqtts": True}


@dataclass(frozen=True, slots=True)
class BrokerAddress:
    """A broker and the credentials that it requires.

    The names are those of the table [broker] in the daemon's configuration.

    Attributes:
        port: None takes 1883, or 8883 with TLS.
        password, password_file: at most one of the two.
        tls: the connection is encrypted and the broker's certificate verified.
        ca_file: CA certificates that signed the broker's; None: the system's.
        certificate_file, key_file: of this client, where the broker requires them.
        keepalive_s: a silent connection is looked at so often.
    """

    host: str = "localhost"
    port: int | None = None
    username: str | None = None
    password: str | None = field(default=None, repr=False)
    password_file: Path | None = None
    tls: bool = False
    ca_file: Path | None = None
    certificate_file: Path | None = None
    key_file: Path | None = None
    keepalive_s: int = 10

    def __post_init__(self) -> None:
        if self.password is not None and self.password_file is not None:
            raise ValueError("password and password_file; expected one of the two")
        files = (self.ca_file, self.certificate_file, self.key_file)
        if not self.tls and any(file is not None for file in files):
            raise ValueError("ca_file, certificate_file, key_file need tls = True")

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read "host", "host:port", "mqtt://host:port" or "mqtts://host:port".

        Raises:
            ValueError: it is none of these.
        """
        parts = urlsplit(text if "://" in text else f"mqtt://{text}")
        try:
            port = parts.port
        except ValueError:
            raise ValueError(
                f"broker {text!r}: its port is no number from 0 to 65535; expected "
                "host, host:port or mqtts://host:port"
            ) from None
        if parts.scheme not in SCHEMES or not parts.hostname or parts.path.strip("/"):
            raise ValueError(
                f"broker {text!r}; expected host, host:port, mqtt://host:port or "
                "mqtts://host:port"
            )
        if parts.username is not None or parts.password is not None:
            raise ValueError(
                "a user's name in the broker's address; expected it as `username`, and "
                "the password as `password_file`"
            )
        return cls(parts.hostname, port, tls=SCHEMES[parts.scheme])

    def __str__(self) -> str:
        return f"{self.host}:{self.tcp_port}"

    @property
    def tcp_port(self) -> int:
        """The port, chosen by `tls` where none is given."""
        return self.port or (TLS_PORT if self.tls else PORT)

    def options(self) -> dict[str, Any]:
        """Arguments of `DiagnosingClient`; files are read now, so they may be renewed.

        Raises:
            OSError: a file cannot be read, or holds not what it should.
        """
        password = self.password
        if self.password_file is not None:
            with _naming_file("password_file", self.password_file, "the password"):
                password = text_of(self.password_file).strip()
        return {
            "hostname": self.host,
            "port": self.tcp_port,
            "username": self.username,
            "password": password,
            "tls_context": self._tls_context() if self.tls else None,
            "keepalive": self.keepalive_s,
        }

    def _tls_context(self) -> ssl.SSLContext:
        with _naming_file("ca_file", self.ca_file, "certificates, PEM"):
            context = tls_context(self.ca_file)
        if self.certificate_file is not None:
            key = self.key_file or self.certificate_file
            wanted = f"a certificate, PEM, and {key} its key without a passphrase"
            with _naming_file("certificate_file", self.certificate_file, wanted):
                load_pair(context, self.certificate_file, self.key_file)
        return context


@contextmanager
def _naming_file(name: str, file: Path | None, wanted: str) -> Iterator[None]:
    """Name the file of an error."""
    try:
        yield
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "no text"
        raise OSError(f"{name} {file}: {why}; expected {wanted}") from error
