"""`traverse page`: the operator's page in a browser."""

import ssl
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from traverse.cli.common.broker_options import BrokerOptions, only_arm
from traverse.cli.common.refusals import refusals

if TYPE_CHECKING:
    from traverse.client.display.arm_state import Change

LOOPBACK = ("127.0.0.1", "::1", "localhost")
FIND_S = 5.0


def page(
    *,
    arm: str | None = None,
    broker: BrokerOptions,
    host: str = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535)] = 8080,
    token_file: Path | None = None,
    certificate: Path | None = None,
    key: Path | None = None,
    show: bool = False,
) -> None:
    """Show an arm in a browser, and take points there.

    Uses MQTT alone, so it runs on any machine. Listens on this machine
    only; with another --host it requires --token-file, --certificate and --key, and
    refuses to start without. Exit status 2: an option was refused; 3: the broker could
    not be reached, or no arm was found there.

    Args:
        arm: Name of the arm; without it the only one on the broker.
        host: Address to listen on; beyond this machine see below.
        port: Port to listen on.
        token_file: File with the token, 16 characters or more.
        certificate: Certificate of this page, PEM.
        key: Its key, PEM.
        show: Open a browser.
    """
    from traverse.broker.credentials import credential_file
    from traverse.client.display.follower import Follower
    from traverse.client.exports.formats import points_as
    from traverse.client.page.access import read_token
    from traverse.client.page.server import serve

    beyond = host not in LOOPBACK
    if beyond and None in (token_file, certificate, key):
        raise typer.BadParameter(
            f"{host} can be reached from elsewhere: give --token-file, --certificate "
            "and --key, or listen on 127.0.0.1",
            param_hint="--host",
        )
    address = broker.address()
    with refusals(OSError, ValueError):
        token_file, certificate, key = (
            None if file is None else credential_file(str(file))
            for file in (token_file, certificate, key)
        )
        token = None if token_file is None else read_token(token_file)
        if certificate is not None:
            _check_pair(certificate, key)
    name = arm or only_arm(address, FIND_S)
    scheme = "http" if certificate is None else "https"
    typer.echo(f"{name} on {address}: {scheme}://{host}:{port}")
    follower = Follower(name, address)
    follower.sight.listeners.append(_notify_absence)
    serve(
        follower,
        points_as,
        host=host,
        port=port,
        token=token,
        certificate=certificate,
        key=key,
        show=show,
    )


def _check_pair(certificate: Path, key: Path | None) -> None:
    """Try a certificate; OSError where it is none, or the key another one's."""
    from traverse.broker.credentials import load_pair

    try:
        load_pair(ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER), certificate, key)
    except ssl.SSLError as error:
        raise OSError(
            f"{certificate} and {key or certificate}: {error.reason or 'no PEM'}; "
            "expected a certificate and its key without a passphrase, PEM"
        ) from error


def _notify_absence(change: "Change") -> None:
    if change.kind == "absent":
        typer.echo(f"{change.text}; waiting for it, Ctrl-C ends", err=True)
