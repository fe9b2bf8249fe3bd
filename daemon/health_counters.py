"""What the daemon has done so far, in numbers for the health message."""

from traverse.daemon.commands.dispatcher import CommandDispatcher
from traverse.daemon.config.filters import removed_counters
from traverse.daemon.mqtt.connection import BrokerConnection
from traverse.daemon.mqtt.outgoing_queue import OutgoingQueue
from traverse.daemon.points.capture import Capture
from traverse.daemon.pose.live import LivePoseSampler
from traverse.daemon.scans.scanner import Scanner
from traverse.daemon.store.scan_store import ScanStore
from traverse.protocol.messages import BrokerHealth


def broker_health(publisher: BrokerConnection, queue: OutgoingQueue) -> BrokerHealth:
    """How the connection is, and what waits for it."""
    dropped = queue.dropped
    return BrokerHealth(
        state=publisher.state,
        host=publisher.address.host,
        port=publisher.address.port,
        reconnects=publisher.reconnects,
        queued=sum(
            queue.waiting(kind)
            for kind in ("point", "event", "resend", "spooled", "scan")
        ),
        queue_limit=queue.limit,
        unacknowledged=queue.waiting("point"),
        dropped=dropped["event"] + dropped["scan"] + dropped["reply"],
    )


def health_counters(
    *,
    capture: Capture,
    scanner: Scanner,
    spool: ScanStore,
    live: LivePoseSampler,
    commands: CommandDispatcher,
    publisher: BrokerConnection,
    queue: OutgoingQueue,
) -> dict[str, int]:
    """All counters, by the name that they have in the health message."""
    return {
        "points_captured": capture.captured,
        "points_retracted": capture.retracted,
        "points_refused": capture.refused,
        "points_published": queue.sent["point"],
        "points_resent": queue.sent["resend"],
        "scan_points_published": scanner.published_points,
        "scan_points_dropped": scanner.dropped_points,
        "scan_blocks_kept": spool.counted["kept"],
        "scan_blocks_unkept": spool.counted["unkept"],
        "scan_blocks_dropped": spool.counted["dropped"] + queue.dropped["scan"],
        "live_published": queue.sent["live"],
        "live_thinned": live.thinned + queue.dropped["live"],
        "events_published": queue.sent["event"],
        "events_dropped": queue.dropped["event"],
        "commands_received": commands.received,
        "commands_refused": commands.refused,
        "reconnects": publisher.reconnects,
        **removed_counters(scanner.chain),
    }
