"""Free memory: one arena for all threads, and large blocks released."""

import re
import sys

from tests.running import run_program

# All of one process: what is set cannot be taken back.
PROGRAM = """
import ctypes, sys, threading
from traverse.daemon.system.memory import limit_malloc_arenas

libc = ctypes.CDLL(None)
libc.malloc.restype = ctypes.c_void_p
libc.malloc.argtypes = libc.free.argtypes = [ctypes.c_void_p]
libc.fopen.restype = ctypes.c_void_p
libc.malloc_info.argtypes = [ctypes.c_int, ctypes.c_void_p]
libc.fclose.argtypes = [ctypes.c_void_p]

if sys.argv[1] == "bounded":
    assert limit_malloc_arenas()
libc.free(libc.malloc(4 << 20))  # by itself, that makes 4 MiB the size that is large
large = [libc.malloc(3 << 20) for _ in range(2)]
together = threading.Barrier(3)

def allocate():
    libc.malloc(5000)
    together.wait()

threads = [threading.Thread(target=allocate) for _ in range(3)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
file = libc.fopen(b"/dev/stdout", b"w")
libc.malloc_info(0, file)
libc.fclose(file)
"""


def report(how):
    run = (sys.executable, "-c", PROGRAM, how)
    return run_program(*run).stdout


def n_mapped(statistics):
    return int(re.search(r'<total type="mmap" count="(\d+)"', statistics)[1])


def test_all_threads_share_one_arena_and_large_blocks_are_mapped():
    usual, bounded = report("usual"), report("bounded")
    assert usual.count("<heap nr=") > 1
    assert bounded.count("<heap nr=") == 1
    assert n_mapped(bounded) == n_mapped(usual) + 2


HOLES = """
import asyncio, ctypes, os
from traverse.daemon.system import memory as allocation

libc = ctypes.CDLL(None)
libc.malloc.restype = ctypes.c_void_p
libc.malloc.argtypes = libc.free.argtypes = [ctypes.c_void_p]

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1])

def holes():
    blocks = [libc.malloc(16_000) for _ in range(2000)]
    for block in blocks:
        ctypes.memset(block, 1, 16_000)
    for block in blocks[::2]:
        libc.free(block)

async def main():
    allocation.TRIM_INTERVAL_S = 0.0
    holes()
    before = resident()
    giving = asyncio.create_task(allocation.trim_memory_periodically())
    await asyncio.sleep(0.0)
    while resident() > before - 1500:
        await asyncio.sleep(0.0)
    giving.cancel()

asyncio.run(asyncio.wait_for(main(), 20.0))
"""


def test_pages_between_blocks_in_use_are_given_back():
    run_program(sys.executable, "-c", HOLES)
