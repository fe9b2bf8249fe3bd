"""The command `resend`: points, or scans, again; and what there is of them."""

from collections.abc import Callable

from traverse.daemon.errors import Result
from traverse.daemon.store.forwarder import RangeResender
from traverse.daemon.store.queries import (
    StoredScanRange,
    read_sessions,
    stored_range,
    stored_scan_range,
)
from traverse.daemon.store.records import StoredSession
from traverse.protocol.messages import ResendArgs

MAX_SESSIONS = 1000
LAST = 2**53 - 1


class PointResend:
    """Executes the command `resend` for points.

    Args:
        ranges: sends ranges of the outbox.
    """

    def __init__(self, ranges: RangeResender) -> None:
        self._ranges = ranges

    async def carry_out(self, args: ResendArgs) -> Result:
        """Begin to send a range again; return what there is.

        Raises:
            RequestRefusedError: too many ranges wait, or the database cannot be read.
        """
        session = args.session
        if session is None:
            found = await self._ranges.query(
                lambda store: read_sessions(store.connection, MAX_SESSIONS)
            )
            return {
                "sessions": [
                    {
                        "session": one.session,
                        "begun_ns": str(one.begun_ns),
                        "first_seq": one.first_seq,
                        "last_seq": one.last_seq,
                    }
                    for one in found
                ]
            }
        self._ranges.check_room()
        to_seq = LAST if args.to_seq is None else args.to_seq
        extent = await self._ranges.query(
            lambda store: stored_range(store.connection, session, args.from_seq, to_seq)
        )
        if extent.points and extent.last_seq is not None:
            # Not later ones: they are sent anyway.
            self._ranges.send(session, args.from_seq, min(to_seq, extent.last_seq))
        return {
            "session": session,
            "from_seq": args.from_seq,
            "to_seq": args.to_seq,
            "points": extent.points,
            "first_seq": extent.first_seq,
            "last_seq": extent.last_seq,
        }


class ScanResend:
    """Answers the command `resend` for scans.

    Args:
        ranges: sends ranges of the spool.
        is_open: whether there is a spool at all.
    """

    def __init__(self, ranges: RangeResender, is_open: Callable[[], bool]) -> None:
        self._ranges = ranges
        self._is_open = is_open

    async def held(self) -> list[StoredSession]:
        """Scans of which there are blocks, oldest first.

        Raises:
            RequestRefusedError: the database cannot be read.
        """
        if not self._is_open():
            return []
        return await self._ranges.query(
            lambda store: read_sessions(store.connection, MAX_SESSIONS)
        )

    async def send(self, scan: str, from_seq: int, to_seq: int | None) -> Result:
        """Begin to send the blocks again that a range of points touches.

        Raises:
            RequestRefusedError: too many ranges wait, or the database cannot be read.
        """
        extent = StoredScanRange()
        if self._is_open():
            self._ranges.check_room()
            end = LAST if to_seq is None else to_seq
            extent = await self._ranges.query(
                lambda store: stored_scan_range(store.connection, scan, from_seq, end)
            )
            if extent.blocks:  # not later ones: they are sent anyway
                self._ranges.send(scan, extent.from_block, min(end, extent.last_block))
        return {
            "scan": scan,
            "session": extent.session,
            "from_seq": from_seq,
            "to_seq": to_seq,
            "blocks": extent.blocks,
            "first_seq": extent.first_seq,
            "last_seq": extent.last_seq,
            "total": extent.total,
        }
