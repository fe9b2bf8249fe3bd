from collections.abc import Iterable
from pathlib import Path

import pytest
from starlette.types import Receive, Scope, Send

from traverse.client.page.access import MAX_WRONG, MOST_ADDRESSES, Guard, read_token

TOKEN = "a-token-of-some-length"


async def served(scope: Scope, receive: Receive, send: Send) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"page"})


class Visit:
    def __init__(self, guard: Guard) -> None:
        self._guard = guard
        self.scheme = "https"
        self.address = "192.0.2.1"
        self.sent: list[dict[str, object]] = []

    async def __call__(
        self,
        path: str = "/",
        method: str = "GET",
        kind: str = "http",
        headers: Iterable[tuple[str, str]] = (),
        body: bytes = b"",
    ) -> int:
        scope: Scope = {
            "type": kind,
            "scheme": self.scheme,
            "client": (self.address, 40_000),
            "path": path,
            "method": method,
            "headers": [(k.encode(), v.encode()) for k, v in headers],
        }

        async def receive() -> dict[str, object]:
            return {"type": "http.request", "body": body}

        async def send(message: dict[str, object]) -> None:
            self.sent.append(message)

        self.sent.clear()
        await self._guard(scope, receive, send)  # type: ignore[arg-type]  # plain dicts
        first = self.sent[0]
        return first.get("status", first.get("code"))  # type: ignore[return-value]  # int

    def header(self, name: bytes) -> str:
        headers = dict(self.sent[0]["headers"])  # type: ignore[call-overload]  # pairs
        return headers[name].decode()


@pytest.mark.parametrize("host", ["localhost:8080", "127.0.0.1:8080", "[::1]:8080"])
async def test_this_machine_sees_it(host: str) -> None:
    visit = Visit(Guard(served, token=None))
    assert await visit(headers=[("host", host)]) == 200
    origin = ("origin", f"http://{host}")
    assert await visit(kind="websocket", headers=[("host", host), origin]) == 200


@pytest.mark.parametrize(
    "headers",
    [
        [("host", "evil.example")],
        [("host", "localhost.evil.example:8080")],
        [],
        [("host", "localhost:8080"), ("origin", "http://evil.example")],
    ],
)
async def test_a_page_of_the_web_cannot_speak_to_it(
    headers: list[tuple[str, str]],
) -> None:
    visit = Visit(Guard(served, token=None))
    assert await visit(headers=headers) == 403
    assert await visit(kind="websocket", headers=headers) == 1008


async def test_with_a_token_the_cookie_opens_page_and_socket() -> None:
    visit = Visit(Guard(served, token=TOKEN))
    assert await visit() == 303
    assert visit.header(b"location") == "/login"
    assert await visit("/login") == 200
    assert await visit("/cloud", "POST") == 401
    assert await visit(kind="websocket") == 1008
    body = b"token=not-this-one-at-all"
    assert await visit("/login", "POST", body=body) == 401
    assert b"not the token" in visit.sent[1]["body"]  # type: ignore[operator]  # bytes
    assert await visit("/login", "POST", body=f"token={TOKEN}".encode()) == 303
    cookie = visit.header(b"set-cookie")
    assert TOKEN not in cookie
    assert {"HttpOnly", "Secure", "SameSite=Strict"} <= set(cookie.split("; "))
    headers = [("cookie", cookie.partition(";")[0])]
    assert await visit(headers=headers) == 200
    assert await visit(kind="websocket", headers=headers) == 200
    assert await visit(headers=[("cookie", "traverse_page=guess")]) == 303


def test_a_short_token_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "token"
    file.write_text("short\n")
    file.chmod(0o640)
    with pytest.raises(ValueError, match="5 characters, expected at least 16"):
        read_token(file)
    file.write_text(f"{TOKEN}\n")
    assert read_token(file) == TOKEN
    file.chmod(0o644)
    with pytest.raises(ValueError, match="every user of this computer may read"):
        read_token(file)


async def test_pages_of_other_origins_and_frames_are_kept_out() -> None:
    visit = Visit(Guard(served, token=TOKEN))
    body = f"token={TOKEN}".encode()
    same_origin = [("host", "arm:8443"), ("origin", "https://arm:8443")]
    other = [("host", "arm:8443"), ("origin", "https://evil.example")]
    assert await visit("/login", "POST", headers=other, body=body) == 403
    assert await visit("/login", "POST", headers=same_origin, body=body) == 303
    cookie = ("cookie", visit.header(b"set-cookie").partition(";")[0])
    assert await visit(kind="websocket", headers=[*other, cookie]) == 1008
    assert await visit(kind="websocket", headers=[*same_origin, cookie]) == 200
    assert await visit(headers=[*same_origin, cookie]) == 200
    assert "frame-ancestors 'none'" in visit.header(b"content-security-policy")
    assert visit.header(b"x-content-type-options") == "nosniff"


async def test_tokens_cannot_be_guessed_without_end() -> None:
    visit = Visit(Guard(served, token=TOKEN))
    statuses = [await visit("/login", "POST", body=b"token=guess") for _ in range(12)]
    assert statuses == [401] * MAX_WRONG + [429] * 2
    assert await visit("/login", "POST", body=f"token={TOKEN}".encode()) == 429
    visit.address = "192.0.2.2"  # the operator, who is locked out by nobody
    assert await visit("/login", "POST", body=f"token={TOKEN}".encode()) == 303


async def test_nor_from_any_number_of_addresses() -> None:
    visit = Visit(Guard(served, token=TOKEN))
    for k in range(MOST_ADDRESSES):
        visit.address = f"2001:db8::{k:x}"
        assert await visit("/login", "POST", body=b"token=guess") == 401
    visit.address = "2001:db8::ffff:1"
    assert await visit("/login", "POST", body=b"token=guess") == 429
