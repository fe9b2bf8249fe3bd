"""HTTP endpoint for GET /metrics, bounded in every direction.

At most `MAX_CLIENTS` at once, each with one request of at most `MAX_REQUEST` bytes and
`LIMIT_S` in all; connections are closed after the answer.
"""

import asyncio
import contextlib
import math
from collections.abc import AsyncIterator, Callable
from email.utils import formatdate

from traverse.daemon.config.schema import MetricsSection
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.monitoring.prometheus import CONTENT_TYPE

MAX_REQUEST = 8192
MAX_CLIENTS = 8
LIMIT_S = 5.0
FRESH_S = 0.1  # however often it is requested
PLAIN = "text/plain; charset=utf-8"


class MetricsEndpoint:
    """Answers scrapes.

    Args:
        text: returns the figures; called at most once in `FRESH_S`.
    """

    def __init__(self, text: Callable[[], str]) -> None:
        self._text = text
        self._clients = 0
        self._cached_text = ""
        self._text_s = -math.inf

    async def serve(
        self, reader: asyncio.StreamReader, out: asyncio.StreamWriter
    ) -> None:
        """Answer one client and close its connection."""
        if self._clients >= MAX_CLIENTS:
            out.transport.abort()
            return
        self._clients += 1
        try:
            async with asyncio.timeout(LIMIT_S):
                out.write(self._answer(await reader.readuntil(b"\r\n\r\n")))
                await out.drain()
                out.close()
                await out.wait_closed()
        except (TimeoutError, OSError, EOFError, asyncio.LimitOverrunError):
            pass  # it is cut
        finally:
            out.transport.abort()
            self._clients -= 1

    def _figures(self) -> str:
        now_s = asyncio.get_running_loop().time()
        if now_s - self._text_s >= FRESH_S:
            self._cached_text, self._text_s = self._text(), now_s
        return self._cached_text

    def _answer(self, request: bytes) -> bytes:
        line, _, _ = request.partition(b"\r\n")
        match line.split(b" "):
            case [b"GET" | b"HEAD" as method, target, b"HTTP/1.0" | b"HTTP/1.1"]:
                if target.partition(b"?")[0] != b"/metrics":
                    return _response("404 Not Found", "only /metrics is here\n")
                return _response(
                    "200 OK", self._figures(), CONTENT_TYPE, body=method == b"GET"
                )
            case [_, _, b"HTTP/1.0" | b"HTTP/1.1"]:
                return _response("405 Method Not Allowed", "only GET\n")
        return _response("400 Bad Request", "this is not HTTP/1.1\n")


def _response(
    status: str, text: str, content_type: str = PLAIN, *, body: bool = True
) -> bytes:
    data = text.encode()
    head = (
        f"HTTP/1.1 {status}\r\nDate: {formatdate(usegmt=True)}\r\n"
        f"Content-Type: {content_type}\r\nContent-Length: {len(data)}\r\n"
        "Connection: close\r\n\r\n"
    ).encode()
    return head + data if body else head


@contextlib.asynccontextmanager
async def metrics_endpoint(
    section: MetricsSection, text: Callable[[], str], events: EventLog
) -> AsyncIterator[None]:
    """Serve within the block, if a port is configured.

    A port that cannot be opened is an event; measuring continues.
    """
    if section.port is None:
        yield
        return
    endpoint = MetricsEndpoint(text)
    try:
        server = await asyncio.start_server(
            endpoint.serve, section.host, section.port, limit=MAX_REQUEST
        )
    except OSError as error:
        events.report(
            "warning",
            "metrics.refused",
            f"{section.host}:{section.port} cannot be listened on: {error.strerror}",
            remedy="correct [metrics], or end what listens there; start anew",
        )
        yield
        return
    try:
        yield
    finally:
        server.close()
        await server.wait_closed()
