"""Attribution of answers to SYNCs.

A position does not identify the SYNC at which it was latched. The nth answer is of the
nth SYNC as long as each SYNC was answered once, and in time. After a SYNC without an
answer the next answer is of that one, late, or of its own. So a node with a pending
answer is accepted again only

- when it has sent all that were pending, by second answers between two SYNCs, or
- when no SYNC was sent, after one that it did answer, for so long that nothing late
  can arrive any more.

The second is caused on purpose: SYNCs pause (`SyncCycleAssembler.pause_until_ns`).
"""

from collections.abc import Iterator

from traverse.drivers.base.values import STATUS_LATE, STATUS_MISSING


class SyncAttribution:
    """Attribution of all nodes, by channel; masks have bit i for channel i.

    Attributes:
        pending: has an unanswered SYNC, whose answer may still come.
        invalidated: answered more often than requested, or lost frames may have been
            its own: counting cannot identify its next answer.
        maybe_unread: of those invalidated by lost frames: a SYNC may have been lost,
            so that a second answer need not be one too many.
        unanswered: has not answered the last SYNC.
        newly_set_up: was set up anew and has not answered since: nothing is pending.
    """

    def __init__(self, n_nodes: int) -> None:
        self._all = (1 << n_nodes) - 1
        self._n_pending = [0] * n_nodes
        self.pending = self.invalidated = self.maybe_unread = self.unanswered = (
            self.newly_set_up
        ) = 0

    def ambiguous(self, answered: int) -> int:
        """Return nodes that answer, but cannot be attributed."""
        return (self.pending | self.invalidated) & (answered | ~self.unanswered)

    def record_missed(self, missed: int) -> None:
        self.unanswered = missed
        self.newly_set_up &= missed
        pending = missed & ~self.newly_set_up
        self.pending |= pending
        for channel in _channels(pending):
            self._n_pending[channel] += 1

    def resolve(self, channel: int) -> bool:
        """Take one off the pending answers of a node; False if there are none."""
        bit = 1 << channel
        if not self.pending & bit:
            return False
        self._n_pending[channel] -= 1
        if not self._n_pending[channel]:
            self.pending ^= bit
        return True

    def invalidate(self, channels: int) -> None:
        """Stop attributing nodes by counting."""
        self.invalidated |= channels

    def invalidate_all(self) -> None:
        """Stop attributing all nodes: frames of unknown ones were lost."""
        self.invalidated = self.maybe_unread = self._all

    def expire(self) -> None:
        """Clear pending answers of nodes that answered the last SYNC.

        A silent node may return with all that is pending, after any time.
        """
        self._forget_pending(self._all & ~self.unanswered)

    def reset(self, channels: int) -> None:
        """Begin with the next answers of nodes that were set up anew."""
        self._forget_pending(channels)
        self.newly_set_up |= channels

    def flag(self, status: bytearray, missed: int) -> bytearray:
        """Return the status of a set, from the nodes' and from misses."""
        if not missed | self.pending | self.invalidated:
            return status
        flagged = bytearray(status)
        for channel in _channels(missed):
            flagged[channel] |= STATUS_MISSING
        for channel in _channels((self.pending | self.invalidated) & ~missed):
            flagged[channel] |= STATUS_LATE
        return flagged

    def _forget_pending(self, channels: int) -> None:
        for channel in _channels(channels & (self.pending | self.invalidated)):
            self._n_pending[channel] = 0
        self.pending &= ~channels
        self.invalidated &= ~channels
        self.maybe_unread &= ~channels


def _channels(mask: int) -> Iterator[int]:
    while mask:
        bit = mask & -mask
        yield bit.bit_length() - 1
        mask ^= bit
