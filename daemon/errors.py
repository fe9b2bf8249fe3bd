"""Refusals that are returned to requesters, and results of requests."""

from collections.abc import Mapping
from typing import Any

Result = Mapping[str, Any]


class RequestRefusedError(Exception):
    """A request that cannot be executed; its sender gets code, text and remedy."""

    def __init__(self, code: str, text: str, remedy: str) -> None:
        super().__init__(text)
        self.code = code
        self.remedy = remedy


class CaptureRefusedError(RequestRefusedError):
    """No point was captured, or none retracted, with the reason."""

    def __init__(self, text: str, remedy: str, code: str = "capture.refused") -> None:
        super().__init__(code, text, remedy)
