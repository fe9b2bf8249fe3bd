"""The command line: the console script `traverse`, and `python -m traverse`."""

import gc
import os
import signal
import sys

INTERRUPTED = 130


def _open_standard_streams() -> None:
    """Open descriptors 0 to 2 where a program was started without them.

    Otherwise the next opened file, a database say, becomes "standard error", and a
    crash is written into it.
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
    handles_interrupts = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if handles_interrupts:  # an import may swallow the exception, or print it
        signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))
    _open_standard_streams()
    if sys.argv[1:2] == ["run"]:  # a daemon's matrices are small
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # searched for long
    gc.disable()  # nothing that is imported is garbage
    from traverse.cli.__main__ import requested  # noqa: PLC0415 - takes a while

    commands = requested()
    gc.enable()
    try:
        if handles_interrupts:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        commands()
    except KeyboardInterrupt:  # outside of what typer guards
        sys.exit(INTERRUPTED)
    finally:
        if handles_interrupts:  # the interpreter ends
            signal.signal(signal.SIGINT, signal.SIG_DFL)


if __name__ == "__main__":
    main()
