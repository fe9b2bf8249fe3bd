"""Access to the page: from the same machine, or with the token, over TLS."""

import hmac
import secrets
import stat
import time
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

from traverse.strict_toml.files import text_of

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

COOKIE = "traverse_page"
LOGIN = "/login"
MAX_FORM_BYTES = 4096
LEAST_TOKEN = 16
MAX_WRONG, WRONG_S = 10, 60.0  # wrong tokens in a time, of all visitors together
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
FORM = """<!doctype html><html lang="en"><meta charset="utf-8">
<meta name="viewport" content="width=device-width"><title>Traverse</title>
<style>body{{font:1.4rem system-ui;background:#0e1116;color:#e8eef7;display:grid;
place-items:center;min-height:90vh}}input,button{{font:inherit;padding:.6rem 1rem;
border-radius:.5rem;border:1px solid #556;display:block;margin:.6rem 0}}</style>
<form method="post" action="/login"><h1>Traverse</h1><p role="alert">{said}</p>
<label>Token<input name="token" type="password" autofocus
autocomplete="current-password"></label><button>Open the page</button></form></html>"""


def read_token(path: Path) -> str:
    """The token that a file holds.

    Raises:
        ValueError: it is too short to be one, or others may read it.
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
    """Pass only requests that may see the page.

    On the own machine names of hosts are checked, so that no page of the web can
    speak to this one by a name of its own that leads here. Elsewhere the token is
    requested once and stored as a cookie, and a page of another origin is refused.

    Args:
        app: what is guarded.
        token: None on the own machine.
        hosts: names under which the page may be requested, without ports.
    """

    def __init__(
        self, app: App, *, token: str | None, hosts: Iterable[str] = LOCAL_NAMES
    ) -> None:
        self._app = app
        self._token = token
        self._hosts = frozenset(hosts)
        # Not the token itself: a cookie is stored in more places.
        self._key = secrets.token_hex(24)
        self._wrong_s: list[float] = []

    async def __call__(self, scope: Scope, receive: Receive, plain: Send) -> None:
        """Deal with a request."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, plain)
            return

        async def send(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *PROTECTION]
            await plain(message)

        headers = {
            name.decode("latin-1").lower(): value.decode("latin-1")
            for name, value in scope.get("headers", [])
        }
        if self._token is None:
            allowed = _name(headers.get("host", "")) in self._hosts
            origin = headers.get("origin", "")
            if allowed and origin:
                allowed = _name(origin.partition("://")[2]) in self._hosts
            if allowed:
                await self._app(scope, receive, send)
            else:
                await _refuse(scope, send, 403, b"not under this name")
        elif headers.get("origin", "").partition("://")[2] not in {
            "",
            headers.get("host", ""),
        }:
            await _refuse(scope, send, 403, b"not from another origin")
        elif hmac.compare_digest(_cookie(headers).encode(), self._key.encode()):
            await self._app(scope, receive, send)
        elif scope["type"] == "http" and scope["path"] == LOGIN:
            await self._login(scope, receive, send)
        elif scope["type"] == "http" and scope["method"] == "GET":
            await _answer(send, 303, b"", [(b"location", LOGIN.encode())])
        else:
            await _refuse(scope, send, 401, b"no token")

    async def _login(self, scope: Scope, receive: Receive, send: Send) -> None:
        said = ""
        now_s = time.monotonic()
        self._wrong_s = [at_s for at_s in self._wrong_s if at_s > now_s - WRONG_S]
        if len(self._wrong_s) >= MAX_WRONG:
            text = f"{MAX_WRONG} wrong tokens in a minute; wait a minute"
            await _refuse(scope, send, 429, text.encode())
            return
        if scope["method"] == "POST":
            given = parse_qs((await _body(receive)).decode("utf-8", "replace"))
            token = given.get("token", [""])[0].encode()
            if hmac.compare_digest(token, (self._token or "").encode()):
                flags = "HttpOnly; SameSite=Strict; Path=/"
                # Without TLS the page is on this machine; some browsers would not
                # keep a secure cookie there.
                flags += "; Secure" if scope.get("scheme") == "https" else ""
                cookie = f"{COOKIE}={self._key}; {flags}".encode()
                await _answer(
                    send, 303, b"", [(b"location", b"/"), (b"set-cookie", cookie)]
                )
                return
            self._wrong_s.append(now_s)
            said = "This is not the token."
        page = FORM.format(said=said).encode()
        kind = [(b"content-type", b"text/html; charset=utf-8")]
        await _answer(send, 401 if said else 200, page, kind)


def _name(host: str) -> str:
    """A host without its port."""
    if host.startswith("["):
        return host.partition("]")[0] + "]"
    return host.partition(":")[0]


def _cookie(headers: dict[str, str]) -> str:
    try:
        found = SimpleCookie(headers.get("cookie", "")).get(COOKIE)
    except CookieError:
        return ""
    return found.value if found is not None else ""


async def _body(receive: Receive) -> bytes:
    body = b""
    while len(body) <= MAX_FORM_BYTES:
        message = await receive()
        body += message.get("body", b"")
        if not message.get("more_body"):
            break
    return body[:MAX_FORM_BYTES]


async def _refuse(scope: Scope, send: Send, status: int, why: bytes) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008})
    else:
        await _answer(send, status, why, [(b"content-type", b"text/plain")])


async def _answer(
    send: Send, status: int, body: bytes, headers: list[tuple[bytes, bytes]]
) -> None:
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
