"""The firmware, compiled once in a session; tests that use it need `compiler`."""

from pathlib import Path

from tests.running import run_program
from tests.shared import new_folder, shared

CHECKOUT = Path(__file__).parents[2]
FIRMWARE = CHECKOUT / "firmware"


@shared
def host_board() -> Path:
    folder = new_folder()
    run_program("make", "-C", FIRMWARE, "host", f"BUILD={folder}", "CC=gcc")
    return folder / "latch-board"


@shared
def bench_library() -> Path:
    """Build the core with the bench of its unit tests, and sanitizers that end it."""
    library = new_folder() / "bench.so"
    run_program(
        *(
            "gcc",
            "-std=c11",
            "-O1",
            "-g",
            "-Wall",
            "-Wextra",
            "-Werror",
            "-fPIC",
            "-shared",
        ),
        *("-fsanitize=undefined", "-fsanitize-undefined-trap-on-error"),
        *("-I", FIRMWARE / "core", "-o", library, Path(__file__).with_name("bench.c")),
        *sorted(FIRMWARE.glob("core/*.c")),
    )
    return library
