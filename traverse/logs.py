"""Where the log goes: plain lines on standard error."""

import logging
import sys


def log_to_stderr(*, verbose: bool = False) -> None:
    """One line an entry: time, level, logger, text."""
    logging.basicConfig(
        level=logging.DEBUG if verbose else logging.INFO,
        stream=sys.stderr,
        format="%(asctime)s %(levelname)-7s %(message)s",
        datefmt="%H:%M:%S",
    )
    logging.getLogger("mqtt").setLevel(logging.ERROR)  # aiomqtt's own chatter
