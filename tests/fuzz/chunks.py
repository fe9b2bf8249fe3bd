"""Cuts of fuzzed bytes."""

from collections.abc import Iterator


def chunks(data: bytes) -> Iterator[bytes]:
    """Everything but the first byte, in pieces as long as that says."""
    size = 1 + (data[0] if data else 0)
    for start in range(1, len(data), size):
        yield data[start : start + size]
