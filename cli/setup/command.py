"""`traverse setup`: a daemon's files made and changed in a browser."""

from pathlib import Path

import typer

from traverse.cli.common.page_options import PageOptions
from traverse.cli.common.refusals import check_target, refusals


def setup(
    config: Path,
    *,
    options: PageOptions,
) -> None:
    """Make the configuration of an arm's daemon in a browser, or change it.

    Run it on the arm's computer: the page shows which ports there are, asks for driver,
    arm file and broker, writes the files that `traverse check` checks, and finds the
    encoder of each joint, for which the daemon must not be running. A file that is
    replaced is kept beside the new one. Listens on this machine only; with another
    --host it requires --token-file, --certificate and --key. Exit status 2: an option
    or the file was refused.

    Args:
        config: The daemon's configuration; need not exist.
    """
    from traverse.cli.setup.draft import Draft
    from traverse.cli.setup.page import serve_setup

    serving = options.serving()
    check_target(config, force=True)
    with refusals():
        draft = Draft(config)
    typer.echo(f"{config}: {serving.url}")
    serve_setup(draft, serving)
