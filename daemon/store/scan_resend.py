"""Blocks of scans again: what is on the disk, and ranges of it for those who ask."""

from collections.abc import Callable

from traverse.daemon.errors import Result
from traverse.daemon.store.queries import read_sessions
from traverse.daemon.store.records import HeldSession
from traverse.daemon.store.resend import LAST, MAX_SESSIONS, RangeResender
from traverse.daemon.store.scan_queries import StoredScanRange, stored_scan_range


class ScanResend:
    """Answers the command `resend` for scans.

    Args:
        ranges: sends ranges of the spool.
        is_open: whether there is a spool at all.
    """

    def __init__(self, ranges: RangeResender, is_open: Callable[[], bool]) -> None:
        self._ranges = ranges
        self._is_open = is_open

    async def held(self) -> list[HeldSession]:
        """Scans of which there are blocks, oldest first.

        Raises:
            RequestRefusedError: the database cannot be read.
        """
        if not self._is_open():
            return []
        return await self._ranges.asked(
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
            extent = await self._ranges.asked(
                lambda store: stored_scan_range(store.connection, scan, from_seq, end)
            )
            if extent.blocks:  # not what comes later: that is sent anyway
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
