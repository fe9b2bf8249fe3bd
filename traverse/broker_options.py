"""Options of commands that go to a broker, and the address that they make."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

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


def broker_address(
    broker: str,
    username: str | None,
    password_file: Path | None,
    ca_file: Path | None,
) -> "BrokerAddress":
    """What the options say.

    Raises:
        ValueError: they are none of a broker, or do not go together.
    """
    from dataclasses import replace  # noqa: PLC0415 - keeps --help quick

    from clients.address import BrokerAddress  # noqa: PLC0415

    return replace(
        BrokerAddress.parse(broker),
        username=username,
        password_file=password_file,
        ca_file=ca_file,
    )
