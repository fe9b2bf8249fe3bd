"""Faults after which the last minutes are kept, and when."""

from traverse.protocol.messages import Event

AFTERMATH_NS = 2_000_000_000  # what follows a fault is kept with it
CALM_NS = 30_000_000_000  # after a file was kept, none is for so long
FAULTS = ("alarm.", "device.", "outbox.", "daemon.", "watchdog.", "realtime.")
"""Beginnings of the codes of errors that are faults."""


class FaultTrigger:
    """Notes faults, and says when to keep what was before them."""

    def __init__(self) -> None:
        self._keep_at: tuple[int, str] | None = None
        self._calm_ns = 0

    def note(self, now_ns: int, event: Event) -> None:
        """An event goes out."""
        is_fault = (
            event.severity == "error"
            and event.active is not False
            and event.code.startswith(FAULTS)
        )
        if is_fault and self._keep_at is None and now_ns >= self._calm_ns:
            self._keep_at = now_ns + AFTERMATH_NS, event.code

    def due(self, now_ns: int) -> str | None:
        """The code of a fault for which the time to keep has come; None: for none."""
        if self._keep_at is None or now_ns < self._keep_at[0]:
            return None
        code, self._keep_at = self._keep_at[1], None
        self._calm_ns = now_ns + CALM_NS
        return code
