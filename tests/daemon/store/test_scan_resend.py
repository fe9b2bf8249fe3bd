import pytest

from tests.daemon.store.outbox_harness import OutboxOnLoop
from tests.daemon.store.scan_store_harness import POINTS, Bench
from tests.protocol.message_examples import SCAN
from traverse.daemon.commands.resend import ResendCommands
from traverse.daemon.errors import RequestRefusedError
from traverse.protocol.messages import ResendArgs


@pytest.mark.parametrize(
    ("from_seq", "to_seq", "numbers"),
    [
        (0, None, [0, 1, 2, 4]),
        (7, 7, [1]),
        (9, 10, [1, 2]),
        (15, 19, []),
        (17, 21, [4]),
        (5, 14, [1, 2]),
        (25, None, []),
    ],
)
async def test_a_range_of_points_is_repeated_in_whole_blocks(
    tmp_path, from_seq, to_seq, numbers
):
    """Block 3, points 15 to 19, has never been: it was dropped."""
    bench = Bench(tmp_path)
    requests = ResendCommands(OutboxOnLoop(tmp_path).outbox, bench.spool, ())
    async with bench.spool.running():
        await bench.offer(0, 1, 2)
        await bench.offer(4, last=True)
        await bench.send_all(4)
        result = await requests.carry_out(
            ResendArgs(scan="scan", from_seq=from_seq, to_seq=to_seq)
        )
        assert result == {
            "scan": "scan",
            "session": SCAN.session,
            "from_seq": from_seq,
            "to_seq": to_seq,
            "blocks": len(numbers),
            "first_seq": 0,
            "last_seq": 24,
            "total": 25,
        }
        sent = await bench.send_all(len(numbers))
    assert sent == [("scan", number) for number in numbers]


async def test_scans_are_listed_and_unknown_ones_are_nothing(tmp_path):
    bench = Bench(tmp_path)
    requests = ResendCommands(OutboxOnLoop(tmp_path).outbox, bench.spool, ())
    async with bench.spool.running():
        await bench.offer(0, 1, scan="a")
        await bench.offer(0, scan="b")
        listed = await requests.carry_out(ResendArgs())
        assert [(s["scan"], s["last_block_seq"]) for s in listed["scans"]] == [
            ("a", POINTS),
            ("b", 0),
        ]
        assert {s["session"] for s in listed["scans"]} == {SCAN.session}
        unknown = await requests.carry_out(ResendArgs(scan="c"))
        assert (unknown["blocks"], unknown["session"]) == (0, None)
        for _ in range(32):
            bench.spool.resender.send("a", 0, 9)
        with pytest.raises(RequestRefusedError, match="32 ranges"):
            await requests.carry_out(ResendArgs(scan="a"))
