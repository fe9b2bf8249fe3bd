"""Address of the broker and its credentials."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Self
from urllib.parse import urlsplit

PORT = 1883
TLS_PORT = 8883
SCHEMES = {"mqtt": False, "mqtts": True}


@dataclass(frozen=True, slots=True)
class BrokerAddress:
    """A broker and the credentials that it requires.

    The names are those of the table [broker] in the daemon's configuration. A file may
    be a credential of systemd: `credential:NAME`.

    Attributes:
        port: None takes 1883, or 8883 with TLS.
        password, password_file: at most one of the two.
        tls: the connection is encrypted and the broker's certificate verified.
        ca_file: CA certificates that signed the broker's; None: the system's.
        certificate_file, key_file: of this client, if the broker requires them.
        keepalive_s: interval of pings on a silent connection.
        folder: base of relative file names.
    """

    host: str = "localhost"
    port: int | None = None
    username: str | None = None
    password: str | None = field(default=None, repr=False)
    password_file: Path | str | None = None
    tls: bool = False
    ca_file: Path | str | None = None
    certificate_file: Path | str | None = None
    key_file: Path | str | None = None
    keepalive_s: int = 10
    folder: Path = Path()

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
            ValueError: another form.
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
