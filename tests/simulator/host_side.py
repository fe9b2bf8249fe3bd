"""What the side of the host hears on a pseudo-terminal."""

import os


def heard(host: int) -> bytes:
    """All that has been written to the other side.

    Read until there is no more: the kernel hands bytes on behind the writer's back, and
    only a read that finds nothing waits for those.
    """
    data = b""
    try:
        while piece := os.read(host, 4096):
            data += piece
    except BlockingIOError:
        return data
    return data
