"""Refusals for requesters, and results of requests."""

from collections.abc import Mapping
from typing import Any

Result = Mapping[str, Any]


class RequestRefusedError(Exception):
    """A refused request; its sender gets code, text and remedy."""

    def __init__(self, code: str, text: str, remedy: str) -> None:
        super().__init__(text)
        self.code = code
        self.remedy = remedy


class CaptureRefusedError(RequestRefusedError):
    """A point was not captured or retracted, with the reason."""

    def __init__(self, text: str, remedy: str, code: str = "capture.refused") -> None:
        super().__init__(code, text, remedy)
