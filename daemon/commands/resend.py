"""The command `resend`: points from the outbox, blocks of scans from the spool."""

from collections.abc import Awaitable, Callable

from traverse.daemon.errors import Result
from traverse.daemon.store.records import StoredSession
from traverse.daemon.store.resend import ScanResend
from traverse.protocol.messages import ResendArgs


class ResendCommands:
    """Carries the command out.

    Args:
        points: does so for points, and for what is held.
        scans: does so for scans.
    """

    def __init__(
        self, points: Callable[[ResendArgs], Awaitable[Result]], scans: ScanResend
    ) -> None:
        self._points = points
        self._scans = scans

    async def carry_out(self, args: ResendArgs) -> Result:
        """Begin to send a range again, or return what is held.

        Raises:
            RequestRefusedError: too many ranges wait, or a database cannot be read.
        """
        if args.scan is not None:
            return await self._scans.send(args.scan, args.from_seq, args.to_seq)
        result = await self._points(args)
        if args.session is not None:
            return result
        return {**result, "scans": [_told(one) for one in await self._scans.held()]}


def _told(scan: StoredSession) -> Result:
    """A scan in the list; its blocks' note is the session."""
    return {
        "scan": scan.session,
        "session": scan.note,
        "begun_ns": str(scan.begun_ns),
        "first_seq": scan.first_seq,
        "last_block_seq": scan.last_seq,
    }
