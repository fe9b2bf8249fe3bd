"""Blocks of scans are cut to what a broker takes, point by point the same."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.protocol.message_examples import POINT, SCAN, STATUS
from traverse.daemon.mqtt.outgoing_queue import OutgoingMessage
from traverse.daemon.mqtt.packet_limit import cut_to_fit
from traverse.protocol.encoding import decode, encode
from traverse.protocol.messages import Scan, Status
from traverse.protocol.messages.scan import ARRAYS


def block(n, *, total=None):
    rows = np.arange(n)
    columns = {"xyz_mm": 3, "ijk": 3, "angles_rad": 6, "covariance_mm2": 6}
    return SCAN.model_copy(
        update={
            **{k: np.add.outer(rows, np.arange(m)) / 7 for k, m in columns.items()},
            "counts": np.add.outer(rows, np.arange(6)),
            "part_xyz_mm": None,
            "quality": rows.astype(np.uint32),
            "dtime_ns": rows * 1_000_000,
            "seq": 1000,
            "last": total is not None,
            "total": total,
        }
    )


def message(scan, encoding="msgpack", **options):
    return OutgoingMessage("t", encode(scan, encoding), 1, **options)


@given(
    n=st.integers(2, 300),
    limit=st.integers(2_500, 60_000),
    encoding=st.sampled_from(["msgpack", "json"]),
)
def test_parts_have_the_points_of_the_whole(n, limit, encoding):
    whole = block(n, total=2000)
    parts = cut_to_fit("scan", message(whole, encoding), limit)
    assert all(len(part.payload) <= limit for part in parts)
    scans = [decode(Scan, part.payload) for part in parts]
    for name in ARRAYS:
        if getattr(whole, name) is not None:
            joined = np.concatenate([getattr(scan, name) for scan in scans])
            np.testing.assert_array_equal(joined, getattr(whole, name))
    times_ns = [scan.time_ns + scan.dtime_ns for scan in scans]
    np.testing.assert_array_equal(
        np.concatenate(times_ns), whole.time_ns + whole.dtime_ns
    )
    ends = np.cumsum([len(scan.dtime_ns) for scan in scans])
    assert [scan.seq for scan in scans] == [1000, *(1000 + ends[:-1]).tolist()]
    assert [scan.last for scan in scans] == [False] * (len(scans) - 1) + [True]
    assert [scan.total for scan in scans][-1] == 2000


def test_the_whole_is_sent_with_its_last_part():
    sent = []
    parts = cut_to_fit(
        "spooled", message(block(100), sent=lambda: sent.append(True)), 5_000
    )
    assert len(parts) > 2
    assert [part.sent is None for part in parts] == [True] * (len(parts) - 1) + [False]
    parts[-1].sent()
    assert sent


@pytest.mark.parametrize("limit", [0, -5, 100])
def test_a_limit_below_one_point_cuts_nothing(limit):
    assert cut_to_fit("scan", message(block(50)), limit) == []


@pytest.mark.parametrize("encoding", ["msgpack", "json"])
def test_a_status_loses_its_lists_and_stays_a_status(encoding):
    condition = STATUS.conditions[0]
    full = STATUS.model_copy(
        update={
            "encoding": encoding,
            "probes": ("a" * 60,) * 10,
            "conditions": (condition,) * 40,
        }
    )
    payload = encode(full, encoding)
    status = OutgoingMessage("t", payload, 1, retain=True)
    bare = full.model_copy(update={"probes": None, "alarms": (), "conditions": ()})
    for limit, expected in (
        (len(payload) - 1, full.model_copy(update={"probes": None})),
        (len(encode(bare, encoding)), bare),
    ):
        (part,) = cut_to_fit("status", status, limit)
        assert part.retain
        assert len(part.payload) <= limit
        assert decode(Status, part.payload) == expected
    assert cut_to_fit("status", status, len(encode(bare, encoding)) - 1) == []


def test_nothing_else_is_cut():
    other = OutgoingMessage("t", encode(POINT, "msgpack"), 1)
    assert cut_to_fit("point", other, 100) == []
    assert cut_to_fit("resend", other, 100) == []  # points are sent again, too
    assert cut_to_fit("scan", OutgoingMessage("t", b"rubbish" * 100), 100) == []
