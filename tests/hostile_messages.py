"""Malicious messages: payloads, topics, response topics."""

import json
from collections.abc import Iterator
from typing import Any

import msgpack
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

SCHEMA = "traverse/command/1"


def envelope(request: Any = "r", args: Any = None, **fields: Any) -> dict[str, Any]:
    return {"schema": SCHEMA, "request": request, "args": args or {}, **fields}


def in_both_encodings(value: Any) -> Iterator[bytes]:
    yield json.dumps(value).encode()
    yield msgpack.packb(value)


def deep(levels: int) -> Iterator[bytes]:
    head, tail = json.dumps(envelope("deep", {"x": 0}))[:-1].split('"x": 0')
    yield (head + '"x": ' + "[" * levels + "]" * levels + tail + "}").encode()
    yield (head + '"x": ' + '{"a":' * levels + "1" + "}" * levels + tail + "}").encode()
    yield b"\x83\xa6schema\xb2traverse/command/1\xa7request\xa1r\xa4args" + (
        b"\x81\xa1a" * levels + b"\xc0"
    )
    yield b"\x91" * levels + b"\xc0"
    yield b"\xdd\x00\x00\x10\x00" * levels  # announces 4096 elements each


def fixed() -> list[bytes]:
    """Payloads known from attacks, and others like them."""
    payloads: list[bytes] = [
        b"",
        b"\x00",
        b"\xc1",
        b"{",
        b"{}",
        b"[]",
        b"null",
        b"\xff" * 1000,
        b"{" * 10_000,
        b'{"schema":' * 1000,
        b'{"a":1,"a":2}',
        b'{"schema":"traverse/command/1","request":"r","args":{"x":NaN}}',
        b'{"schema":"traverse/command/1","request":"r","args":{"x":1e999}}',
        b'{"schema":"traverse/command/1","request":"r","args":{"x":'
        + b"9" * 10_000
        + b"}}",
        b'{"schema":"traverse/command/1","request":"\\ud800","args":{}}',
        b"x" * 16_385,
        b"x" * 60_000,
        b"\xdf\xff\xff\xff\xff",  # a map of 4 thousand millions
        b"\xdd\xff\xff\xff\xff",
        b"\xc6\xff\xff\xff\xff",
        b"\xc9\xff\xff\xff\xff\x01",
        b"\xd8\x01" + bytes(16),
    ]
    for levels in (17, 500, 3000):
        payloads += deep(levels)
    wrong = [
        {"samples": -1},
        {"samples": "1"},
        {"samples": 1.0},
        {"samples": True},
        {"samples": 2**63},
        {"samples": None, "dwell_s": 1e308},
        {"samples": [1]},
        {"dwell_s": {"a": 1}},
        {"__class__": "x", "__proto__": {"x": 1}},
        {"action": "start", "rate_hz": 1e-300},
        {"action": "start", "mode": "planes", "normal": [1e308, 1e308, 1e308]},
        {"action": "set", "rotation": [[1e300] * 3] * 3, "translation_mm": [0, 0, 0]},
        {"name": "../../etc/passwd"},
        {"name": "a\n2026-01-01 ERROR forged"},
        {"name": "%s%n{0.__class__}$(reboot)`reboot`"},
        {"session": "'; DROP TABLE points; --", "from_seq": 0},
        {"k" * 64: "v" * 2000},
    ]
    for args in wrong:
        payloads += in_both_encodings(envelope(f"w{len(payloads)}", args))
    for request in ("", "r" * 65, 7, None, ["r"], {"r": 1}, "r\0\n\x1b[2J"):
        payloads += in_both_encodings(envelope(request))
    payloads += in_both_encodings({**envelope(), "schema": "traverse/command/2"})
    payloads += in_both_encodings(envelope(f"m{len(payloads)}", more=1))
    return payloads


_PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**70), 2**70) | st.floats() | st.text(),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4)
    ),
    max_leaves=12,
)
_ENVELOPES = st.builds(
    envelope,
    st.text(max_size=70) | _PLAIN,
    st.dictionaries(
        st.sampled_from(["samples", "action", "name", "session", "rotation"])
        | st.text(max_size=70),
        _PLAIN,
        max_size=4,
    ),
)


def _packed(value: Any) -> bytes:
    try:
        packed: bytes = msgpack.packb(value, unicode_errors="surrogatepass")
    except (OverflowError, ValueError):
        return json.dumps(value).encode()
    return packed


payloads = (
    st.binary(max_size=200)
    | _ENVELOPES.map(_packed)
    | _ENVELOPES.map(lambda value: json.dumps(value).encode())
    | st.builds(
        lambda value, cut: _packed(value)[:-cut], _ENVELOPES, st.integers(1, 30)
    )
    | st.sampled_from(fixed())
)
names = st.sampled_from(
    ["point", "scan", "undo", "label", "probe", "align", "resend"]
) | st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=70)


def examples(strategy: st.SearchStrategy[Any], n: int) -> list[Any]:
    """So many values of a strategy, the same ones in every run."""
    drawn: list[Any] = []

    @settings(max_examples=n, derandomize=True, database=None, phases=[Phase.generate])
    @given(strategy)
    def collect(example: Any) -> None:
        drawn.append(example)

    collect()
    return drawn
