"""The command line: the console script `traverse`, and `python -m traverse`."""

import gc
import os
import sys

INTERRUPTED = 130


def _open_standard_streams() -> None:
    """Give the descriptors 0 to 2 something to be, where a program was begun without.

    Else the next file that is opened is "standard error", and a crash is written into
    it: a database, say.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free
    if sys.stderr is None:
        sys.stderr = open(2, "w", closefd=False)  # noqa: SIM115 - to the end
    if sys.stdout is None:
        sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115 - to the end


def main() -> None:
    """Run the command line; Ctrl-C ends it without a traceback from the start on."""
    _open_standard_streams()
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
