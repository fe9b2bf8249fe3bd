"""How the C library keeps memory that is free: in one place, and not for ever.

A daemon runs for months, and what it holds must not creep. Two habits of glibc's malloc
make it creep; both are good for programs that compute on many threads at once, which
this is not (one thread at a time has Python's lock):

- Each thread gets an arena of its own. The reader thread allocates what the event loop
  frees, the loop what the recorder frees. So each arena is full of holes at sizes that
  its own thread does not use, and grows by some hundred kilobytes a minute.
- A large block is mapped by itself and given back when it is freed; but the first one
  freed raises the size that counts as large to its own, up to 32 MiB. From then on such
  blocks (a message's buffer, a chunk of a recording and what compresses it) come from
  the heap; whatever small is put behind one of them keeps it from shrinking again.

Both are set here and not in the unit's environment, so that a daemon that is started by
hand is the same. Holes remain: arrays of a block are larger when the computer is busy
and more samples arrive at once. Their pages are returned twice a minute, which takes
less than half a millisecond.
"""

import asyncio
import ctypes

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -3, -8  # of <malloc.h>
LARGE_BYTES = 128 << 10  # glibc's own beginning, which is kept by setting it
TRIM_INTERVAL_S = 30.0
SPARE_BYTES = 512 << 10  # free at the heap's end: so much is not given back


def limit_malloc_arenas() -> bool:
    """Have free memory reused by all threads, and large blocks given back.

    To be called before the first thread is started. False where there is no glibc, or
    where it refuses.
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
    """Give whole pages that are free back to the system now and then, until cancelled.

    Where they are locked in memory they stay.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    while trim is not None:
        await asyncio.sleep(TRIM_INTERVAL_S)
        trim(SPARE_BYTES)
