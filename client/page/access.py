"""Access to the page: from the same machine, or with the token, over TLS."""

import hmac
import secrets
import stat
import time
from collections.abc import Iterable
from pathlib import Path
from urllib.parse import parse_qs

from starlette.requests import HTTPConnection
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

from traverse.strict_toml.files import text_of

COOKIE = "traverse_page"
LOGIN = "/login"
MAX_FORM_BYTES = 4096
LEAST_TOKEN = 16
MAX_WRONG, WRONG_S = 10, 60.0  # wrong tokens in a time, from one address
MOST_ADDRESSES = 1000  # of wrong tokens in that time; then all have to wait
PROTECTION = (
    (
        b"content-security-policy",
        b"frame-ancestors 'none'; object-src 'none'; base-uri 'self'; "
        b"form-action 'self'",
    ),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"same-origin"),
)
LOCAL_NAMES = frozenset(("localhost", "127.0.0.1", "[::1]"))
FORM = text_of(Path(__file__).with_name("login.html"))


def read_token(path: Path) -> str:
    """Return the token in a file.

    Raises:
        ValueError: it is too short, or others may read it.
        OSError: the file cannot be read.
    """
    token = text_of(path).strip()
    if path.stat().st_mode & stat.S_IROTH:
        raise ValueError(
            f"{path}: every user of this computer may read the token; "
            f"correct its rights: chmod o-rwx {path}"
        )
    if len(token) < LEAST_TOKEN:
        raise ValueError(
            f"{path}: a token of {len(token)} characters, expected at least "
            f"{LEAST_TOKEN}; make one with: openssl rand -hex 24"
        )
    return token


class Guard:
    """Passes only requests that may see the page.

    On the same machine names of hosts are checked, which defeats DNS rebinding.
    Elsewhere the token is requested once and stored as a cookie, and a page of another
    origin is refused.

    Args:
        token: None on the own machine.
        hosts: allowed names of the page's host, without ports.
    """

    def __init__(
        self, app: ASGIApp, *, token: str | None, hosts: Iterable[str] = LOCAL_NAMES
    ) -> None:
        self._app = app
        self._token = token
        self._hosts = frozenset(hosts)
        # Not the token itself: a cookie is stored in more places.
        self._key = secrets.token_hex(24)
        self._wrong_s: dict[str, list[float]] = {}

    async def __call__(self, scope: Scope, receive: Receive, plain: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, plain)
            return

        async def send(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *PROTECTION]
            await plain(message)

        answer = await self._answer(scope, receive)
        await answer(scope, receive, send)

    async def _answer(self, scope: Scope, receive: Receive) -> ASGIApp:
        request = HTTPConnection(scope)
        host = request.headers.get("host", "")
        origin = request.headers.get("origin", "")
        from_host = origin.partition("://")[2]
        if self._token is None:
            allowed = _name(host) in self._hosts
            if origin:
                allowed = allowed and _name(from_host) in self._hosts
            refused = _refusal(scope, 403, "not under this name")
            return self._app if allowed else refused
        if from_host not in ("", host):
            return _refusal(scope, 403, "not from another origin")
        cookie = request.cookies.get(COOKIE, "")
        if hmac.compare_digest(cookie.encode(), self._key.encode()):
            return self._app
        if scope["type"] == "http" and scope["path"] == LOGIN:
            return await self._login(scope, receive)
        if scope["type"] == "http" and scope["method"] == "GET":
            return RedirectResponse(LOGIN, 303)
        return _refusal(scope, 401, "no token")

    async def _login(self, scope: Scope, receive: Receive) -> ASGIApp:
        now_s = time.monotonic()
        self._wrong_s = {
            visitor: recent_s
            for visitor, times_s in self._wrong_s.items()
            if (recent_s := [at_s for at_s in times_s if at_s > now_s - WRONG_S])
        }
        address = str((scope.get("client") or ("",))[0])
        wrong_s = self._wrong_s.get(address, [])
        if len(wrong_s) >= MAX_WRONG or len(self._wrong_s) >= MOST_ADDRESSES:
            text = f"{MAX_WRONG} wrong tokens in a minute; wait a minute"
            return _refusal(scope, 429, text)
        if scope["method"] != "POST":
            return HTMLResponse(FORM.replace("{said}", ""))
        form = parse_qs((await _body(receive)).decode("utf-8", "replace"))
        token = form.get("token", [""])[0].encode()
        if hmac.compare_digest(token, (self._token or "").encode()):
            flags = "HttpOnly; SameSite=Strict; Path=/"
            # Without TLS the page is on this machine; some browsers would not keep a
            # secure cookie there.
            flags += "; Secure" if scope.get("scheme") == "https" else ""
            cookie = f"{COOKIE}={self._key}; {flags}"
            return RedirectResponse("/", 303, {"set-cookie": cookie})
        self._wrong_s[address] = [*wrong_s, now_s]
        return HTMLResponse(FORM.replace("{said}", "This is not the token."), 401)


def _name(host: str) -> str:
    if host.startswith("["):
        return host.partition("]")[0] + "]"
    return host.partition(":")[0]


async def _body(receive: Receive) -> bytes:
    body = b""
    while len(body) <= MAX_FORM_BYTES:
        message = await receive()
        body += message.get("body", b"")
        if not message.get("more_body"):
            break
    return body[:MAX_FORM_BYTES]


def _refusal(scope: Scope, status: int, why: str) -> ASGIApp:
    if scope["type"] == "websocket":
        return WebSocketClose(1008)
    return PlainTextResponse(why, status)
