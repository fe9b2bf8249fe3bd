import binascii
import struct
from dataclasses import dataclass, field

import numpy as np
import pytest

from traverse.simulator.devices.latch_board.board import Board
from traverse.simulator.devices.latch_board.sampler import TickCounter
from traverse.simulator.devices.latch_board.wire import Identity
from traverse.simulator.devices.wrong_clock import WrongClock
from traverse.simulator.scenario.signals import AlarmChange, InputChange

IDENTITY = Identity(bytes(12), (1, 0, 0), 2, 1, 1_000_000, 10_000_000, 77, (24,), (9,))
HELLO = "01 01 01 01"


@dataclass
class Bench:
    """Counts that encode the microsecond of the latch; changes as given."""

    changes: list = field(default_factory=list)

    def latch(self, times_s, edge):
        counts = np.floor(times_s * 1e6 + 1e-3).astype(np.uint32)[:, None]
        return counts + edge, np.zeros((len(times_s), 1), dtype=np.uint8)

    def peek_change(self):
        return self.changes[0] if self.changes else None

    def take_change(self):
        self.changes.pop(0)


class Talk:
    def __init__(self, changes=(), first_ticks=0, ppm=0.0, warming_c_s=0.0):
        self.edges = []
        self.board = Board(
            IDENTITY,
            TickCounter(1_000_000, WrongClock(error_ppm=ppm), first_ticks, 0.0),
            Bench(sorted(changes, key=lambda change: change.time_s)),
            temperatures_c=[21.5],
            power_up_s=0.0,
            on_edge=lambda seq, edge: self.edges.append((seq, edge)),
            warming_c=lambda now_s: warming_c_s * now_s,
        )

    def until(self, time_s, kinds="all"):
        return self._read(self.board.advance(time_s), kinds)

    def ask(self, body):
        body = bytes.fromhex(body)
        checked = body + binascii.crc_hqx(body, 0xFFFF).to_bytes(2, "little")
        parts = [bytes([len(p) + 1]) + p for p in checked.split(b"\0")]
        return self._read(self.board.receive(b"".join(parts) + b"\0"), "all")

    @staticmethod
    def _read(frames, kinds):
        bodies = []
        for frame in frames:
            body, offset, data = bytearray(), 0, frame.data[:-1]
            while offset < len(data):
                body += data[offset + 1 : offset + data[offset]]
                offset += data[offset]
                body += b"\0" if offset < len(data) else b""
            bodies.append(bytes(body[:-2]))
        return [b for b in bodies if kinds == "all" or b[0] == kinds]


def shown(bodies):
    return [body.hex(" ").upper() for body in bodies]


def test_before_hello_a_request_is_refused():
    assert shown(Talk().ask("04 09")) == ["82 04 09 06 00 00 00 00"]


CONVERSATION = [
    (HELLO, ["81 01 01 00" + " 00" * 12 + " 01 00 00 01 02 01 40 42 0F 00 80 96 98 00"
             " 4D 00 00 00 18 09 00 00 00"]),
    ("02 02 FF E8 03 88 13 88 13 00 00", ["82 02 02 00 00 00 00 00"]),
    ("03 03 40 42 0F 00", ["82 03 03 00 40 42 0F 00"]),
    ("04 04", ["82 04 04 00 00 00 00 00"]),
    ("05 05", ["83 01 05 00 00 00 00 00 64 00 00 00 64 00 00 00 00"]),
    ("06 00 00 00 00", []),
]  # fmt: skip


def test_a_whole_conversation():
    talk = Talk()
    talk.until(100e-6)
    for sent, answers in CONVERSATION:
        assert shown(talk.ask(sent)) == answers


def test_heartbeats_begin_at_power_up_and_tell_what_comes_next():
    talk = Talk()
    first, second = talk.until(1.5, 0x87)
    assert shown([first]) == ["87 00 00 00" + " 00" * 20]
    assert struct.unpack_from("<I", second, 4)[0] == 1_000_000
    talk.ask(HELLO)
    talk.ask("03 03 40 42 0F 00")
    talk.until(1.9)
    beat = talk.until(2.5, 0x87)[0]
    assert beat[1] == 1
    assert struct.unpack_from("<I", beat, 8)[0] == 500


def test_temperatures_come_every_five_seconds():
    talk = Talk()
    bodies = talk.until(10.0, 0x85)
    assert len(bodies) == 3
    assert shown(bodies)[0] == "85 00 00 00 00 66 08"


def test_temperatures_follow_the_climate():
    bodies = Talk(warming_c_s=0.1).until(10.0, 0x85)
    shown_c = [struct.unpack_from("<h", body, 5)[0] / 100.0 for body in bodies]
    assert shown_c == [21.5, 22.0, 22.5]


@pytest.mark.parametrize("rate_millihz", [333_333, 9_999_999, 1_000_000, 7, 10_000_000])
def test_the_mean_rate_is_exact_and_no_tick_is_off_by_more_than_half(rate_millihz):
    talk = Talk()
    talk.ask(HELLO)
    talk.ask("03 03 " + rate_millihz.to_bytes(4, "little").hex())
    seconds = 400.0 if rate_millihz == 7 else 3.0
    bodies = []
    for end_s in np.arange(0.0, seconds, 0.0137 if rate_millihz > 7 else 5.0):
        bodies += talk.until(end_s, 0x83)
    fields = [struct.unpack_from("<II", body, 4) for body in bodies]
    assert [seq for seq, _ in fields] == list(range(len(fields)))
    assert len(fields) >= 2
    first = fields[0][1]
    assert first == 1
    for seq, tick in fields:
        exact_twice = 2 * seq * 1_000_000 * 1000
        assert abs(2 * (tick - first) * rate_millihz - exact_twice) <= rate_millihz
    period = 1e9 / rate_millihz
    assert abs((fields[-1][1] - first) / (len(fields) - 1) - period) * len(fields) <= 1


def test_cutting_time_into_other_pieces_changes_nothing():
    streams = []
    for pieces in ([2.0], [*np.arange(0.0007, 2.0, 0.0113), 2.0]):
        talk = Talk([InputChange(0.31234567, 0, 1), InputChange(0.5, 0, 0)])
        talk.ask(HELLO)
        talk.ask("03 03 " + (333_333).to_bytes(4, "little").hex())
        streams.append([body for end in pieces for body in talk.until(end)])
    assert streams[0] == streams[1]


def test_ticks_wrap_and_samples_are_latched_at_their_ticks():
    talk = Talk(first_ticks=2**32 - 1500)
    talk.ask(HELLO)
    talk.ask("03 03 40 42 0F 00")
    bodies = talk.until(0.004, 0x83)
    fields = [struct.unpack_from("<III", body, 4) for body in bodies]
    assert [f[1] for f in fields] == [2**32 - 1499, 2**32 - 499, 501, 1501]
    assert [f[2] for f in fields] == [1, 1001, 2001, 3001]


def test_a_fast_quartz_latches_earlier():
    talk = Talk(ppm=100.0)
    talk.ask(HELLO)
    talk.ask("03 03 E8 03 00 00")
    last = talk.until(100.0, 0x83)[-1]
    seq, ticks, count = struct.unpack_from("<III", last, 4)
    assert ticks == 1 + seq * 1_000_000
    assert count == pytest.approx(ticks / 1.0001, abs=2)


def test_an_edge_is_latched_at_its_first_change_and_sent_once_it_has_held():
    talk = Talk([InputChange(0.0123456, 1, 1)])
    talk.ask(HELLO)
    assert talk.until(0.0173, 0x84) == []
    bodies = talk.until(0.0174, 0x84)
    assert shown(bodies) == ["84 01 01 02 00 00 00 00 39 30 00 00 3A 30 00 00 00"]


def test_a_bounce_shorter_than_the_debouncing_is_no_edge():
    talk = Talk([InputChange(0.010, 0, 1), InputChange(0.012, 0, 0)])
    talk.ask(HELLO)
    assert talk.until(0.5, 0x84) == []
    assert talk.board.edges.next_seq == 0


def test_a_press_that_bounces_is_one_edge_at_its_first_contact():
    times_s = (0.010, 0.0103, 0.0105, 0.0106, 0.013)
    talk = Talk([InputChange(t, 0, (n + 1) % 2) for n, t in enumerate(times_s)])
    talk.ask(HELLO)
    assert talk.until(0.0179, 0x84) == []
    (body,) = talk.until(0.05, 0x84)
    assert struct.unpack_from("<BBBII", body, 1) == (0, 1, 1, 0, 10_000)


def test_masked_inputs_make_no_edges_but_show_in_samples():
    talk = Talk([InputChange(0.010, 1, 1)])
    talk.ask(HELLO)
    talk.ask("02 02 01 00 00 00 00 88 13 00 00")
    talk.ask("03 03 A0 86 01 00")
    bodies = talk.until(0.1)
    assert {body[0] for body in bodies} == {0x83}
    assert bodies[-1][3] == 2


def test_edges_are_sent_again_every_50_ms_until_they_are_acknowledged():
    talk = Talk([InputChange(0.010, 0, 1), InputChange(0.030, 0, 0)])
    talk.ask(HELLO)
    seqs = [struct.unpack_from("<I", b, 4)[0] for b in talk.until(0.134, 0x84)]
    assert seqs == [0, 1, 0, 1, 0]
    talk.ask("06 00 00 00 00")
    seqs = [struct.unpack_from("<I", b, 4)[0] for b in talk.until(0.2, 0x84)]
    assert seqs == [1, 1]
    talk.ask("06 01 00 00 00")
    assert talk.until(5.0, 0x84) == []


def test_hello_can_forget_edges():
    talk = Talk([InputChange(0.010, 0, 1)])
    talk.until(0.02)
    talk.ask("01 01 01 00")
    assert len(talk.until(0.1, 0x84)) > 0
    talk.ask("01 01 01 01")
    assert talk.until(0.5, 0x84) == []


def test_edges_beyond_sixteen_are_lost_with_an_alarm_and_their_seq_used_up():
    changes = [InputChange(0.01 * (i + 1), 0, (i + 1) % 2) for i in range(20)]
    talk = Talk(changes)
    talk.ask(HELLO)
    bodies = talk.until(0.22)
    seqs = {struct.unpack_from("<I", b, 4)[0] for b in bodies if b[0] == 0x84}
    assert seqs == set(range(16))
    alarms = [body for body in bodies if body[0] == 0x86]
    assert [(a[1], a[2], a[3], a[13]) for a in alarms] == [
        (255, 1, 7, n) for n in (1, 2, 3, 4)
    ]
    assert talk.board.edges.next_seq == 20
    cleared = talk.ask("06 0F 00 00 00")
    assert [(a[1], a[2], a[3]) for a in cleared] == [(255, 0, 7)]
    assert len(talk.edges) == 20


def test_dropped_samples_are_counted_and_alarmed_once():
    talk = Talk()
    talk.ask(HELLO)
    talk.ask("03 03 40 42 0F 00")
    talk.until(0.1)
    assert len(talk.board.count_dropped(3)) == 1
    assert talk.board.count_dropped(2) == []
    bodies = talk.until(1.2)
    (cleared,) = [body for body in bodies if body[0] == 0x86]
    assert (cleared[1], cleared[2], cleared[3], cleared[13]) == (255, 0, 6, 5)
    (beat,) = [body for body in bodies if body[0] == 0x87]
    assert struct.unpack_from("<I", beat, 16)[0] == 5


def test_alarms_of_encoders_are_passed_on():
    talk = Talk([AlarmChange(0.25, 0, 1, 2, -5)])
    (body,) = talk.until(0.3, 0x86)
    assert shown([body]) == ["86 00 01 02 00 00 00 00 00 90 D0 03 00 FB FF FF FF"]
