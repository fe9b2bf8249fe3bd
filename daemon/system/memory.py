"""Settings of the C library's allocator against slow growth.

Two habits of glibc's malloc suit programs that compute on many threads, but make the
memory of a daemon grow for months (one thread at a time has Python's lock):

- Each thread gets an arena of its own. The reader thread allocates what the event loop
  frees, the loop what the recorder frees. So each arena is full of holes at sizes that
  its own thread does not use, and grows by some hundred kilobytes a minute.
- A large block is mapped by itself and unmapped when freed; but the first one freed
  raises the threshold of "large" to its size, up to 32 MiB. Later blocks (a message's
  buffer, a chunk of a recording, its compressor) come from the heap, and a small block
  behind one of them keeps it from shrinking.

Both are set here and not in the unit's environment, so that a daemon started by hand is
the same. Holes remain, since blocks are larger on a busy computer; their pages are
returned twice a minute, in less than half a millisecond.
"""

import asyncio
import ctypes

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -3, -8  # of <malloc.h>
LARGE_BYTES = 128 << 10  # glibc's own beginning, which is kept by setting it
TRIM_INTERVAL_S = 30.0
SPARE_BYTES = 512 << 10  # free at the heap's end: so much is not given back


def limit_malloc_arenas() -> bool:
    """Share free memory among threads, and unmap large blocks.

    Call before the first thread starts. False without glibc, or where it refuses.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    settings = (
        (M_ARENA_MAX, 1),
        (M_MMAP_THRESHOLD, LARGE_BYTES),
        (M_TRIM_THRESHOLD, SPARE_BYTES),
    )
    return 0 not in [mallopt(name, value) for name, value in settings]


async def trim_memory_periodically() -> None:
    """Return free pages to the system at intervals, until cancelled.

    Pages that are locked in memory stay.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    while trim is not None:
        await asyncio.sleep(TRIM_INTERVAL_S)
        trim(SPARE_BYTES)
