"""The command `resend`: list stored points and scans, or send them again."""

from collections.abc import Iterable

from traverse.daemon.command_handlers import handles
from traverse.daemon.errors import Result
from traverse.daemon.store.durable_queue import DurableQueue
from traverse.daemon.store.queries import (
    StoredScanRange,
    read_sessions,
    stored_range,
    stored_scan_range,
)
from traverse.daemon.store.records import StoredSession
from traverse.protocol.messages import ResendArgs
from traverse.protocol.messages.later_doubt import LaterDoubt

MAX_SESSIONS = 1000
MAX_DOUBTS = 200
LAST = 2**53 - 1


class ResendCommands:
    """Executes the command.

    Args:
        scans: store of scan blocks, perhaps not open.
        doubts: what is in doubt since it was stored, oldest first.
    """

    def __init__(
        self, points: DurableQueue, scans: DurableQueue, doubts: Iterable[LaterDoubt]
    ) -> None:
        self._points = points
        self._scans = scans
        self._doubts = doubts

    @handles(ResendArgs)
    async def carry_out(self, args: ResendArgs) -> Result:
        """Begin to send a range, or list what is stored.

        Raises:
            RequestRefusedError: too many ranges wait, or a database cannot be read.
        """
        to_seq = LAST if args.to_seq is None else args.to_seq
        if args.scan is not None:
            return await self._send_scan(args, args.scan, to_seq)
        if args.session is not None:
            return await self._send_points(args, args.session, to_seq)
        return {
            "sessions": [
                {
                    "session": session.session,
                    "begun_ns": str(session.begun_ns),
                    "first_seq": session.first_seq,
                    "last_seq": session.last_seq,
                }
                for session in await _sessions(self._points)
            ],
            "scans": [
                {
                    "scan": scan.session,
                    "session": scan.note,
                    "begun_ns": str(scan.begun_ns),
                    "first_seq": scan.first_seq,
                    "last_block_seq": scan.last_seq,
                }
                for scan in await _sessions(self._scans)
            ],
            "doubts": [d.data for d in self._doubts][-MAX_DOUBTS:],
        }

    async def _send_points(self, args: ResendArgs, session: str, to_seq: int) -> Result:
        self._points.resender.check_room()
        extent = await self._points.query(
            lambda store: stored_range(store.connection, session, args.from_seq, to_seq)
        )
        if extent.points and extent.last_seq is not None:
            # Not later ones: they are sent anyway.
            end = min(to_seq, extent.last_seq)
            self._points.resender.send(session, args.from_seq, end)
        return {
            "session": session,
            "from_seq": args.from_seq,
            "to_seq": args.to_seq,
            "points": extent.points,
            "first_seq": extent.first_seq,
            "last_seq": extent.last_seq,
        }

    async def _send_scan(self, args: ResendArgs, scan: str, to_seq: int) -> Result:
        """Send the blocks that contain a range of points."""
        extent = StoredScanRange()
        if self._scans.is_open:
            self._scans.resender.check_room()
            extent = await self._scans.query(
                lambda store: stored_scan_range(
                    store.connection, scan, args.from_seq, to_seq
                )
            )
            if extent.blocks:  # not later ones: they are sent anyway
                end = min(to_seq, extent.last_block)
                self._scans.resender.send(scan, extent.from_block, end)
        return {
            "scan": scan,
            "session": extent.session,
            "from_seq": args.from_seq,
            "to_seq": args.to_seq,
            "blocks": extent.blocks,
            "first_seq": extent.first_seq,
            "last_seq": extent.last_seq,
            "total": extent.total,
        }


async def _sessions(store: DurableQueue) -> list[StoredSession]:
    if not store.is_open:
        return []
    return await store.query(
        lambda database: read_sessions(database.connection, MAX_SESSIONS)
    )
