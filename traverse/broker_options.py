"""Options of commands that go to a broker, and the address that they make."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from traverse.refusals import refuse

if TYPE_CHECKING:
    from clients.address import BrokerAddress

BrokerOption = Annotated[
    str, typer.Option(help="MQTT broker: host, host:port or mqtts://host:port.")
]
UsernameOption = Annotated[str | None, typer.Option(help="For the broker.")]
PasswordFileOption = Annotated[
    Path | None, typer.Option(help="File with the broker's password.")
]
CaFileOption = Annotated[
    Path | None, typer.Option(help="Certificates that the broker's come from.")
]
CertificateOption = Annotated[
    Path | None,
    typer.Option("--client-certificate", help="Shown to the broker, PEM."),
]
KeyOption = Annotated[
    Path | None, typer.Option("--client-key", help="Key of that certificate, PEM.")
]


def broker_address(
    command: str,
    broker: str,
    login: tuple[str | None, Path | None],
    tls: tuple[Path | None, Path | None, Path | None],
) -> "BrokerAddress":
    """What the options say; ends the command where they or their files are bad.

    Args:
        command: for what is said.
        broker: of `--broker`.
        login: user's name and the file with the password.
        tls: files of authority, own certificate, its key.
    """
    from dataclasses import replace  # noqa: PLC0415 - keeps --help quick

    from clients.address import BrokerAddress  # noqa: PLC0415

    username, password_file = login
    ca_file, certificate_file, key_file = tls
    try:
        address = replace(
            BrokerAddress.parse(broker),
            username=username,
            password_file=password_file,
            ca_file=ca_file,
            certificate_file=certificate_file,
            key_file=key_file,
        )
        address.options()  # its files can be read
    except (OSError, ValueError) as error:
        refuse(command, str(error))
    return address
