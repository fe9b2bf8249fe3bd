"""The command line: the console script `traverse`, and `python -m traverse`."""

import sys

INTERRUPTED = 130


def main() -> None:
    """Run the command line; Ctrl-C ends it without a traceback from the start on."""
    try:
        from traverse.cli.__main__ import main as run  # noqa: PLC0415 - takes a second
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    run()


if __name__ == "__main__":
    main()
