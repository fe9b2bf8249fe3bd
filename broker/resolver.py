"""Addresses of a host, looked up on a thread that nobody has to wait for.

A resolver that does not answer takes half a minute, and asyncio's own lookup would keep
the program from ending for that time. A lookup that hangs serves all who ask meanwhile.
"""

import asyncio
import socket
from collections.abc import Callable
from concurrent.futures import Future
from ssl import SSLContext
from threading import Thread

PATIENCE_S = 1.0  # with an address that does not answer, while there are others

_lookups: dict[tuple[str, int], Future[list[str]]] = {}


async def connect_to_host(
    protocol: Callable[[], asyncio.BaseProtocol],
    host: str,
    port: int,
    tls: SSLContext | None,
) -> None:
    """Connect to the first address of a host that answers.

    Raises:
        OSError: none did; the error of the last one.
    """
    loop, failure = asyncio.get_running_loop(), None
    name = host if tls is not None else None
    addresses = await addresses_of(host, port)
    for address in addresses:
        patience_s = None if address == addresses[-1] else PATIENCE_S
        try:
            async with asyncio.timeout(patience_s):
                await loop.create_connection(
                    protocol, address, port, ssl=tls, server_hostname=name
                )
        except OSError as error:
            failure = error
        else:
            return
    raise failure or OSError(f"{host} has no address")


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
