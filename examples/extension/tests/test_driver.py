"""The driver keeps the contract of all drivers; its peer is at the end of a pty."""

from traverse_example.driver import AsciiHubDriver, parse_reply

from traverse.testing.driver_contract import DriverContract, StreamContract
from traverse.testing.pty_peer import PeerRig, PtyPeer, rig_fixture


class Hub(PtyPeer):
    """Answers; the count of each channel rises by one from reading to reading."""

    def __init__(self, link):
        super().__init__(link)
        self.counts = [0, 0]
        self.to_lose = 0

    def _live(self):
        while self._plugged:
            for request in self.receive(0.01).split():
                channel = int(request[1:])
                self.counts[channel] += 1
                if self.to_lose:
                    self.to_lose -= 1
                    continue
                count = self.counts[channel]
                total = (count & 255) + (count >> 8)
                self.send(b"%x %x\n" % (count, total % 256))


class HubRig(PeerRig):
    def lose(self, n):
        self.peer.to_lose += n


rig = rig_fixture(
    lambda folder: HubRig(
        Hub(folder / "hub"), AsciiHubDriver, counts_per_turn=(65536, 65536)
    )
)


class TestAsciiHub(DriverContract, StreamContract):
    dropped = ("missed_0",)


def test_a_reply_is_its_count_if_the_sum_is_right():
    assert parse_reply(b"1ff 0") == 0x1FF
    assert parse_reply(b"1ff 1") is None
    assert parse_reply(b"") is None
    assert parse_reply(b"123456789 0") is None
