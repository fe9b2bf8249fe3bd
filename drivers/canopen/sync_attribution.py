"""Which answers nodes owe, and when an answer is of its SYNC for certain.

A position says nothing of the SYNC at which it was latched. The nth answer is of the
nth SYNC as long as each SYNC was answered once, and in time. After a SYNC without an
answer the next answer is of that one, late, or of its own: nothing in it tells. So a
node that has owed an answer is believed again only

- when it has made up for all it owed, by second answers between two SYNCs, or
- when no SYNC was sent, after one that it did answer, for so long that nothing late
  can come any more.

The second is brought about on purpose: SYNCs pause (`Cycles.pause_until_ns`).
"""

from collections.abc import Iterator

from traverse.drivers.base.values import STATUS_LATE, STATUS_MISSING


class SyncAttribution:
    """Of all nodes, by channel; masks have bit i for channel i.

    Args:
        n_nodes: how many.

    Attributes:
        owing: has not answered some SYNC, and may do so yet.
        spoiled: has answered more often than it was asked, or frames were lost that
            may have been its own: no counting tells any more what its next answer is.
        unseen: of those spoiled, by lost frames: a SYNC may have been among them, so a
            second answer need not be one too many.
        silent: has not answered the last SYNC.
        fresh: was set up anew and has not answered since: it owes nothing.
    """

    def __init__(self, n_nodes: int) -> None:
        self._all = (1 << n_nodes) - 1
        self._owed = [0] * n_nodes
        self.owing = self.spoiled = self.unseen = self.silent = self.fresh = 0

    def unclear(self, answered: int) -> int:
        """Who answers, but cannot be believed."""
        return (self.owing | self.spoiled) & (answered | ~self.silent)

    def close(self, missed: int) -> None:
        """A SYNC is over; these have not answered it."""
        self.silent = missed
        self.fresh &= missed
        owing = missed & ~self.fresh
        self.owing |= owing
        for channel in _channels(owing):
            self._owed[channel] += 1

    def resolve(self, channel: int) -> bool:
        """Take one off what a node owes, if it owes any."""
        bit = 1 << channel
        if not self.owing & bit:
            return False
        self._owed[channel] -= 1
        if not self._owed[channel]:
            self.owing ^= bit
        return True

    def spoil(self, channels: int) -> None:
        """What these send is no longer to be had by counting."""
        self.spoiled |= channels

    def invalidate_all(self) -> None:
        """Frames were lost, of whom nobody knows."""
        self.spoiled = self.unseen = self._all

    def expire(self) -> None:
        """Nothing late can come any more of those who have answered the last SYNC.

        Of the others no time is long enough: whoever stands still may come back with
        all that it owes.
        """
        self._forget_pending(self._all & ~self.silent)

    def trust(self, channels: int) -> None:
        """These have been set up anew: they begin with their next answer."""
        self._forget_pending(channels)
        self.fresh |= channels

    def judge(self, status: bytearray, missed: int) -> bytearray:
        """The status of a set, from that of the nodes and from who has missed it."""
        if not missed | self.owing | self.spoiled:
            return status
        told = bytearray(status)
        for channel in _channels(missed):
            told[channel] |= STATUS_MISSING
        for channel in _channels((self.owing | self.spoiled) & ~missed):
            told[channel] |= STATUS_LATE
        return told

    def _forget_pending(self, channels: int) -> None:
        for channel in _channels(channels & (self.owing | self.spoiled)):
            self._owed[channel] = 0
        self.owing &= ~channels
        self.spoiled &= ~channels
        self.unseen &= ~channels


def _channels(mask: int) -> Iterator[int]:
    while mask:
        bit = mask & -mask
        yield bit.bit_length() - 1
        mask ^= bit
