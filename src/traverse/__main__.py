"""The command line: the console script `traverse`, and `python -m traverse`."""

import gc
import os
import sys

INTERRUPTED = 130


def main() -> None:
    """Run the command line; Ctrl-C ends it without a traceback from the start on."""
    if sys.argv[1:2] == ["run"]:  # a daemon's matrices are small
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # searched for long
    gc.disable()  # nothing that is imported is garbage
    try:
        from traverse.cli.__main__ import requested  # noqa: PLC0415 - takes a while

        commands = requested()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    gc.enable()
    commands()


if __name__ == "__main__":
    main()
