"""`traverse page`: the operator's page in a browser."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from traverse.cli.common.broker_options import BrokerOptions, only_arm
from traverse.cli.common.page_options import PageOptions
from traverse.cli.common.refusals import refusals

if TYPE_CHECKING:
    from traverse.client.display.arm_state import Change

FIND_S = 5.0


def page(
    *,
    arm: str | None = None,
    logo: Path | None = None,
    broker: BrokerOptions,
    options: PageOptions,
) -> None:
    """Show an arm in a browser, and take points there.

    Uses MQTT alone, so it runs on any machine. Listens on this machine
    only; with another --host it requires --token-file, --certificate and --key, and
    refuses to start without. Exit status 2: an option was refused; 3: the broker could
    not be reached, no arm was found there, or the port is taken.

    Args:
        arm: Name of the arm; without it the only one on the broker.
        logo: Picture for the report of a part, PNG or JPEG.
    """
    from traverse.client.display.follower import Follower
    from traverse.client.exports.formats import points_as
    from traverse.client.inspection.logo import logo_uri
    from traverse.client.page.server import serve

    serving = options.serving()
    with refusals(ValueError):
        picture = "" if logo is None else logo_uri(logo)
    address = broker.address()
    name = arm or only_arm(address, FIND_S)
    typer.echo(f"{name} on {address}: {serving.url}")
    follower = Follower(name, address)
    follower.sight.listeners.append(_notify_absence)
    serve(follower, points_as, serving, picture)


def _notify_absence(change: "Change") -> None:
    if change.kind == "absent":
        typer.echo(f"{change.text}; waiting for it, Ctrl-C ends", err=True)
