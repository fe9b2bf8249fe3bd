"""Addresses of a host, looked up on a thread that nobody has to wait for.

A resolver that does not answer takes half a minute, and asyncio's own lookup would keep
the program from ending for that time. A lookup that hangs serves all who ask meanwhile.
"""

import asyncio
import socket
from concurrent.futures import Future
from threading import Thread

_lookups: dict[tuple[str, int], Future[list[str]]] = {}


async def addresses_of(host: str, port: int) -> list[str]:
    """Return addresses in the order in which they are to be tried.

    Raises:
        OSError: there are none.
    """
    place = host, port
    lookup = _lookups.get(place)
    if lookup is None:
        lookup = _lookups[place] = Future()
        Thread(
            target=_look_up, args=(place, lookup), name="resolver", daemon=True
        ).start()
    return await asyncio.shield(asyncio.wrap_future(lookup))


def _look_up(place: tuple[str, int], lookup: Future[list[str]]) -> None:
    try:
        answers = socket.getaddrinfo(*place, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        failure = error
        if isinstance(error, UnicodeError):  # a label of a name is too long, or empty
            failure = socket.gaierror(socket.EAI_NONAME, str(error))
        del _lookups[place]
        lookup.set_exception(failure)
    else:
        del _lookups[place]
        lookup.set_result([str(address) for *_, (address, *_) in answers])
