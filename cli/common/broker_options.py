"""Options of commands that go to a broker, and the address that they make."""

import asyncio
from dataclasses import dataclass, replace
from pathlib import Path

from traverse.broker.address import BrokerAddress
from traverse.cli.common.refusals import REFUSED, UNREACHABLE, end, refusals


@dataclass(frozen=True, slots=True, kw_only=True)
class BrokerOptions:
    """The options, in the order of `--help`.

    Attributes:
        broker: MQTT broker: host, host:port or mqtts://host:port.
        username: User name at the broker.
        password_file: File with the broker's password.
        ca_file: CA certificates of the broker's; else the system's.
        client_certificate: Client certificate, PEM.
        client_key: Key of that certificate, PEM.
    """

    broker: str = "localhost"
    username: str | None = None
    password_file: Path | None = None
    ca_file: Path | None = None
    client_certificate: Path | None = None
    client_key: Path | None = None

    def address(self) -> BrokerAddress:
        """Their values; ends the command where they or their files are bad."""
        from traverse.broker.credentials import CredentialsError, read_credentials

        with refusals(CredentialsError, ValueError):
            address = replace(
                BrokerAddress.parse(self.broker),
                username=self.username,
                password_file=self.password_file,
                ca_file=self.ca_file,
                certificate_file=self.client_certificate,
                key_file=self.client_key,
            )
            read_credentials(address)  # they can be read
        return address


def arms_at(broker: BrokerAddress, seconds: float) -> list[str]:
    """Names of all arms with a status at a broker; ends the command without one."""
    from traverse.client.errors import BrokerUnreachableError
    from traverse.client.mqtt.subscription import find_arms

    try:
        return asyncio.run(find_arms(broker, seconds))
    except BrokerUnreachableError as error:
        end(UNREACHABLE, str(error))


def only_arm(broker: BrokerAddress, seconds: float) -> str:
    """Name of the one arm at a broker; ends the command where there is another."""
    arms = arms_at(broker, seconds)
    if len(arms) != 1:
        known_arms = f"there are {', '.join(arms)}" if arms else "there is none yet"
        status = REFUSED if arms else UNREACHABLE
        end(status, f"which arm? {known_arms} on {broker}; name it with --arm-name")
    return arms[0]
