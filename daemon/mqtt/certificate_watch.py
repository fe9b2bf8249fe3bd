"""Warnings before a certificate ends: the connection would not come back."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from traverse.daemon.clock import HostClock
from traverse.daemon.monitoring.events import EventLog

WARN_BEFORE = timedelta(days=14)
REPEAT_NS = 24 * 3600 * 10**9


@dataclass(eq=False)
class CertificateWatch:
    """Report certificates that end within `WARN_BEFORE`, once a day.

    No lasting event: the points of a connection that still stands are good.
    """

    events: EventLog
    clock: HostClock

    def __post_init__(self) -> None:
        self._reported_ns: dict[str, int] = {}

    def check(self, ends: Mapping[str, datetime]) -> None:
        """Look at the certificates of a connection; call often."""
        for name, end in ends.items():
            now_ns = self.clock.monotonic_ns()
            if now_ns - self._reported_ns.get(name, now_ns - REPEAT_NS) < REPEAT_NS:
                continue
            now = datetime.fromtimestamp(self.clock.to_utc_ns(now_ns) // 10**9, UTC)
            if end - now > WARN_BEFORE:
                continue
            self._reported_ns[name] = now_ns
            is_ours = name != "the broker's certificate"
            verb = "ends" if end > now else "has ended"
            certificate = f"{name} of [broker]" if is_ours else name
            self.events.report(
                "warning",
                "broker.certificate",
                f"{certificate} {verb} on {end:%Y-%m-%d %H:%M} UTC; after that the "
                "broker is not connected to again once the connection is lost",
                source="broker",
                remedy=f"renew {certificate}"
                + "; it is used after `systemctl reload`, or a restart" * is_ours,
                distinct=True,
            )
