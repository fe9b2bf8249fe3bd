import numpy as np

from tests.protocol.message_examples import SCAN
from traverse.client.feeds import Feed, ScanBlocks
from traverse.client.results import ResentScan, StartedScan
from traverse.protocol.messages import Scan


def block(seq: int, *, last: bool = False) -> Scan:
    total = seq + len(SCAN.dtime_ns) if last else None
    return SCAN.model_copy(update={"seq": seq, "last": last, "total": total})


async def test_what_is_repeated_is_left_out_and_gaps_are_counted() -> None:
    n = len(SCAN.dtime_ns)
    feed = Feed[Scan](20, keep_newest=False)

    async def follow() -> Feed[Scan]:
        return feed

    async def start() -> StartedScan:
        return StartedScan(scan=SCAN.scan, rate_hz=100.0)

    async def stop() -> None:
        raise AssertionError("it has ended by itself")

    async with ScanBlocks(follow, start, stop) as blocks:
        for seq in (0, n, 0, n, 3 * n):
            feed.put(block(seq))
        feed.put(block(4 * n, last=True))
        seqs = [received.seq async for received in blocks]
    assert seqs == [0, n, 3 * n, 4 * n]
    assert blocks.missing == n
    assert np.all(np.diff(seqs) > 0)


def test_the_answer_about_a_scan_that_is_not_held_is_read() -> None:
    nothing = {"session": None, "first_seq": None, "last_seq": None, "total": None}
    answer = ResentScan.read({"scan": "s", "blocks": 0, **nothing})
    assert answer == ResentScan(scan="s", blocks=0)
