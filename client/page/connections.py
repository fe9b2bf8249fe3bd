"""Connections to the page's server: bounded by address, and never silent.

uvicorn keeps a connection without requests for ever. A thousand of them would take all
descriptors.
"""

import asyncio
from typing import TYPE_CHECKING, Any, ClassVar

from uvicorn.protocols.http.auto import AutoHTTPProtocol

if TYPE_CHECKING:
    from uvicorn.protocols.http.h11_impl import H11Protocol as HttpProtocol
else:
    HttpProtocol = AutoHTTPProtocol

REQUEST_S = 10.0  # in which a request has to come, head and body
MOST_OF_ONE = 64  # connections from an address; a browser opens six
MOST = 512


class BoundedHttpProtocol(HttpProtocol):
    """uvicorn's protocol with bounds."""

    open_transports: ClassVar[dict[str, set[asyncio.Transport]]] = {}
    """By address, websockets included."""

    def connection_made(  # type: ignore[override]  # as uvicorn's
        self, transport: asyncio.Transport
    ) -> None:
        super().connection_made(transport)
        peer: Any = transport.get_extra_info("peername")
        address = str(peer[0]) if isinstance(peer, tuple) else ""
        if self._is_beyond_bounds(address):
            transport.abort()
            return
        self.open_transports.setdefault(address, set()).add(transport)
        loop = asyncio.get_running_loop()
        loop.call_later(REQUEST_S, self._close_if_silent, transport)

    def _is_beyond_bounds(self, address: str) -> bool:
        for other, transports in list(self.open_transports.items()):
            transports -= {t for t in transports if t.is_closing()}
            if not transports:
                del self.open_transports[other]
        n_open = sum(map(len, self.open_transports.values()))
        of_address = len(self.open_transports.get(address, ()))
        return n_open >= MOST or of_address >= MOST_OF_ONE

    def _close_if_silent(
        self, transport: asyncio.Transport, before: object = None
    ) -> None:
        """Close it if no request, or no rest of one, has come since the last call."""
        if transport.is_closing() or transport.get_protocol() is not self:
            return  # a websocket has another protocol by then
        request: Any = self.cycle
        is_answering = request is not None and not (
            request.more_body or request.response_complete
        )
        if request is before and not is_answering:
            transport.abort()
            return
        loop = asyncio.get_running_loop()
        loop.call_later(REQUEST_S, self._close_if_silent, transport, request)
