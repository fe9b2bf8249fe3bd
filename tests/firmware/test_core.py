"""The core of the firmware in its own bytes, written by hand from the page."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.firmware.built import FIRMWARE
from tests.firmware.core_bench import CoreBench, shown
from tests.protocol import latch_board_frames as golden
from tests.protocol.latch_board_frames import frame, framed
from tests.running import run_program

pytestmark = pytest.mark.needs("compiler")

HELLO = "01 01 01 00"
START_1_KHZ = "03 03 40 42 0F 00"
NO_HEARTBEATS = "02 02 FF 00 00 00 00 88 13 00 00"
EDGE, ALARM, TEMPERATURES, HEARTBEAT, SAMPLE = 0x84, 0x86, 0x85, 0x87, 0x83


def quiet(**options) -> CoreBench:
    """A board that has been greeted and sends nothing unasked."""
    bench = CoreBench(**options)
    bench.ask(HELLO)
    bench.ask(NO_HEARTBEATS)
    bench.after(1)
    return bench


def test_frames_of_the_page_byte_for_byte():
    bench = CoreBench(temperatures=1)
    assert bench.wire(frame(golden.HELLO_REQUEST)) == frame(golden.HELLO)
    assert bench.wire(frame(golden.CONFIGURE)) == framed(
        bytes.fromhex("82 02 02 00 00 00 00 00")
    )
    assert bench.wire(frame(golden.START_1_KHZ)) == frame(golden.REPLY)
    assert bench.ask("04 04") == ["82 04 04 00 00 00 00 00"]
    bench.after(10_000)
    assert bench.ask("05 05") == [
        "83 01 05 00 00 00 00 00 10 27 00 00 10 27 00 00 F8 2A 00 00 00 00"
    ]
    assert bench.wire(frame(golden.EDGE_ACK_258)) == b""


REFUSALS = [
    ("STOP before HELLO", ["04 09"], ["82 04 09 06 00 00 00 00"]),
    ("LATCH before HELLO", ["05 09"], ["82 05 09 06 00 00 00 00"]),
    ("EDGE_ACK before HELLO", ["06 00 00 00 00"], []),
    ("major 2", ["01 05 02 00"], ["82 01 05 04 01 00 00 00"]),
    ("all else of major 2", ["01 05 02 00", "04 06"], []),
    ("unknown of major 2", ["01 05 02 00", "1F 06"], []),
    ("rate of 0", [HELLO, "03 06 00 00 00 00"], ["82 03 06 03 80 96 98 00"]),
    ("10 000.001 Hz", [HELLO, "03 06 81 96 98 00"], ["82 03 06 03 80 96 98 00"]),
    (
        "debouncing for 1.000001 s",
        [HELLO, "02 07 FF 00 00 00 00 41 42 0F 00"],
        ["82 02 07 05 00 00 00 00"],
    ),
    ("unknown request", [HELLO, "1F 08"], ["82 1F 08 01 00 00 00 00"]),
    ("unknown request before HELLO", ["7F 08 01"], ["82 7F 08 01 00 00 00 00"]),
    ("START without a rate", [HELLO, "03 08"], ["82 03 08 02 00 00 00 00"]),
    ("HELLO with a byte too many", ["01 08 01 00 00"], ["82 01 08 02 00 00 00 00"]),
    ("a request without its number", [HELLO, "04"], []),
    ("EDGE_ACK of three bytes", [HELLO, "06 00 00 00"], []),
    ("a type of the board's", [HELLO, "83 01"], []),
]


@pytest.mark.parametrize(("case", "sent", "answers"), REFUSALS)
def test_what_cannot_be_done_is_answered_with_the_reason(case, sent, answers):
    bench = CoreBench()
    *before, last = sent
    for body in before:
        bench.ask(body)
    assert bench.ask(last) == answers, case


def rejected(bench: CoreBench) -> int:
    (beat,) = bench.after(1_000_000, HEARTBEAT)
    return struct.unpack_from("<I", beat, 20)[0]


@pytest.mark.parametrize(
    ("data", "n_rejected"),
    [
        (b"\0\0\0", 0),
        (b"\x05\x04\0", 1),  # the distance is beyond the end
        (b"\x03\x04\x04\0", 1),  # too short for a CRC and a body
        (b"\x05\x04\x04\x4f\x92\0", 1),  # a wrong CRC
        (b"\x01" * 253 + b"\0", 1),
        (b"\x02" * 600 + b"\0", 1),  # too long, once
        (b"\x02" * 254 + b"\0" + b"\x05\x04\0", 2),
        (framed(b"\x83\x01"), 1),
        (framed(b"\x06\0\0\0"), 1),
        (framed(b"\x1f" + bytes(249)), 1),  # the longest frame; answered
    ],
)
def test_garbage_is_counted_and_the_next_request_is_answered(data, n_rejected):
    bench = CoreBench()
    bench.after(1)
    bench.wire(data)
    assert rejected(bench) == n_rejected
    assert bench.ask("04 04") == ["82 04 04 06 00 00 00 00"]


@given(noise=st.binary(max_size=400))
def test_after_any_bytes_and_a_delimiter_a_request_is_answered(noise):
    bench = quiet()
    bench.wire(noise + b"\0")
    answers = bench.ask(HELLO)
    assert answers[0].startswith("81 01 01")


def test_a_half_request_of_a_host_that_has_gone_is_forgotten():
    bench = quiet()
    bench.ask(START_1_KHZ)
    bench.wire(frame(golden.STOP)[:3])
    bench.host_gone()
    assert bench.after(5000, SAMPLE) == []
    assert bench.ask("04 04") == ["82 04 04 00 00 00 00 00"]


def test_heartbeats_and_temperatures_begin_at_power_up():
    bench = CoreBench(first_ticks=0xFFFFFF00)
    assert shown(bench.after(1)) == [
        "87 00 00 00 01 FF FF FF" + " 00" * 16,
        "85 01 FF FF FF FC 08 00 80",
    ]
    later = bench.after(10_000_000)
    assert [body[0] for body in later].count(HEARTBEAT) == 10
    assert [body[0] for body in later].count(TEMPERATURES) == 2


def test_periods_of_zero_switch_them_off():
    assert quiet().after(60_000_000) == []


def test_a_heartbeat_says_what_comes_next():
    bench = CoreBench()
    bench.ask(HELLO)
    bench.ask(START_1_KHZ)
    bench.after(1)
    bench.inputs(1)
    beats = bench.after(1_000_000, HEARTBEAT)
    state, inputs, back, ticks, sample, edge = struct.unpack_from(
        "<3BIII", beats[-1], 1
    )
    assert (state, inputs, back, ticks) == (1, 1, 1, 1_000_001)
    assert (sample, edge) == (1000, 1)
    bench.ask("04 04")
    beats = bench.after(1_000_000, HEARTBEAT)
    assert struct.unpack_from("<BBBIII", beats[-1], 1)[0::4] == (0, 1000)


RATES = [333_333, 9_999_999, 1_000_000, 7, 10_000_000]


@pytest.mark.parametrize("rate_hz", [1_000_000, 250_000, 99_999_999])
@pytest.mark.parametrize("rate_millihz", RATES)
def test_every_sample_is_at_its_tick_over_wraps(rate_millihz, rate_hz):
    bench = quiet(rate_hz=rate_hz, first_ticks=2**32 - 1500)
    bench.ask("03 03 " + rate_millihz.to_bytes(4, "little").hex())
    period = 1000 * rate_hz / rate_millihz
    bodies = bench.after(rate_hz // 1000, SAMPLE)
    for _ in range(20):
        bodies += bench.after(int(50 * period), SAMPLE, poll_every=2**30)
    fields = [struct.unpack_from("<III", body, 4) for body in bodies]
    seqs, ticks, counts = zip(*fields, strict=True)
    assert len(seqs) >= 999
    assert seqs == tuple(range(len(seqs)))
    assert counts == ticks
    first = ticks[0]
    assert (first - (2**32 - 1499)) % 2**32 <= rate_hz // 100
    for seq, tick in zip(seqs, ticks, strict=True):
        twice = 2 * seq * rate_hz * 1000  # round(k a / b) = (2 k a + b) // 2 b
        offset = (twice + rate_millihz) // (2 * rate_millihz)
        assert tick == (first + offset) % 2**32


@pytest.mark.slow
def test_a_day_of_samples_and_presses_over_forty_wraps():
    rate_hz, minute_s, minutes = 2_000_000, 60, 24 * 60
    bench = CoreBench(rate_hz=rate_hz)
    bench.ask(HELLO)
    bench.ask("03 03 E8 03 00 00")  # 1 Hz
    samples, edges, beats = [], [], 0
    for minute in range(minutes):
        bench.room(60_000)
        if minute % 60 == 30:
            bench.inputs(1 - len(edges) % 2)
        for body in bench.after(minute_s * rate_hz, poll_every=rate_hz // 10):
            if body[0] == SAMPLE:
                samples.append(struct.unpack_from("<II", body, 4))
            elif body[0] == EDGE:
                number, tick = struct.unpack_from("<II", body, 4)
                if number == len(edges):
                    edges.append(tick)
                bench.wire(framed(b"\x06" + number.to_bytes(4, "little")))
            beats += body[0] == HEARTBEAT
    first = samples[0][1]
    assert samples == [(n, (first + n * rate_hz) % 2**32) for n in range(len(samples))]
    assert len(samples) >= minutes * minute_s - 1
    assert len(edges) == 24
    hour = 60 * minute_s * rate_hz
    assert edges == [(edges[0] + n * hour) % 2**32 for n in range(24)]
    assert beats >= minutes * minute_s


def test_start_replaces_a_stream_and_stop_ends_it():
    bench = quiet()
    bench.ask(START_1_KHZ)
    bench.after(5500)
    bench.ask("03 09 A0 86 01 00")  # 100 Hz
    second = bench.after(25_000, SAMPLE)
    assert [(b[2], b[4]) for b in second] == [(9, 0), (9, 1), (9, 2)]
    bench.ask("04 04")
    assert bench.after(100_000, SAMPLE) == []
    bench.ask(START_1_KHZ)
    assert bench.ask(HELLO)[0].startswith("81")
    assert bench.after(100_000, SAMPLE) == []


def test_what_a_busy_main_loop_misses_is_counted_and_numbered():
    bench = quiet()
    bench.ask(START_1_KHZ)
    bodies = bench.after(20_500, poll_every=0) + bench.after(1000)
    assert [b[4] for b in bodies if b[0] == SAMPLE] == [*range(16), 20]
    (alarm,) = [b for b in bench.after(1000) + bodies if b[0] == ALARM]
    assert (alarm[1:5], alarm[13]) == (b"\xff\x01\x06\x00", 4)


def test_a_line_that_is_full_loses_samples_only():
    bench = quiet()
    bench.ask(START_1_KHZ)
    bench.inputs(1)
    bench.room(10)
    assert bench.after(100_400) == []  # not even an edge has room
    bench.room(60_000)
    bodies = bench.after(1000)
    assert [b[0] for b in bodies] == [EDGE, ALARM, SAMPLE]
    assert (bodies[1][1:5], bodies[1][13]) == (b"\xff\x01\x06\x00", 100)
    (cleared,) = bench.after(1_100_000, ALARM)
    assert (cleared[1:5], cleared[13]) == (b"\xff\x00\x06\x00", 100)


def test_an_edge_has_the_counts_of_its_first_change_and_comes_once_it_has_held():
    bench = quiet()
    bench.inputs(2, after_ticks=12_344)
    assert bench.after(4999, EDGE) == []
    assert shown(bench.after(1, EDGE)) == [
        "84 01 01 02 00 00 00 00 39 30 00 00 39 30 00 00 21 34 00 00 00 00"
    ]


def test_bounces_belong_to_the_press_that_begins_with_them():
    bench = quiet()
    for levels, after_ticks in ((1, 9), (0, 300), (1, 200), (0, 100), (1, 2000)):
        bench.inputs(levels, after_ticks)
    assert bench.after(4999, EDGE) == []
    (body,) = bench.after(1, EDGE)
    assert (body[2], struct.unpack_from("<I", body, 8)[0]) == (1, 10)


def test_a_pulse_shorter_than_the_debouncing_is_no_edge():
    bench = quiet()
    bench.inputs(1, 10)
    bench.inputs(0, 4000)
    assert bench.after(500_000) == []
    bench.inputs(1)
    assert bench.after(6000, EDGE)[0][4] == 0


@pytest.mark.parametrize("busy", [False, True])
def test_edges_do_not_depend_on_when_the_main_loop_runs(busy):
    bench = quiet()
    changes = ((1, 10), (3, 1000), (2, 20_000), (0, 6000), (1, 5000))
    bodies = []
    for levels, after_ticks in changes:
        if not busy:
            bodies += bench.after(0, EDGE)
        bench.inputs(levels, after_ticks)
    bodies += bench.after(5000, EDGE)
    seen = [(b[1], b[2], b[4], struct.unpack_from("<I", b, 8)[0]) for b in bodies]
    assert seen == [
        (0, 1, 0, 11),
        (1, 1, 1, 1011),
        (0, 0, 2, 21_011),
        (1, 0, 3, 27_011),
        (0, 1, 4, 32_011),
    ]


def test_without_debouncing_each_change_is_an_edge():
    bench = quiet()
    bench.ask("02 02 FF 00 00 00 00 00 00 00 00")
    for levels in (1, 0, 1):
        bench.inputs(levels, 1)
    assert [b[2] for b in bench.after(0, EDGE)] == [1, 0, 1]


def test_an_input_that_chatters_faster_than_the_queue_ends_at_its_level():
    bench = quiet()
    for k in range(40):
        bench.inputs((k + 1) % 2, 10)
    bench.inputs(1, 10)
    assert bench.after(0, EDGE) == []  # from here on its level is known
    (body,) = bench.after(5000, EDGE)
    assert (body[1], body[2]) == (0, 1)


def test_a_masked_input_makes_no_edge_and_shows_in_samples():
    bench = quiet()
    bench.ask("02 02 01 00 00 00 00 88 13 00 00")
    bench.inputs(2)
    bench.ask("03 03 A0 86 01 00")
    bodies = bench.after(100_000)
    assert {b[0] for b in bodies} == {SAMPLE}
    assert bodies[-1][3] == 2


def test_edges_are_sent_every_50_ms_until_they_are_acknowledged():
    bench = quiet()
    bench.inputs(1, 10_000)
    bench.after(15_000)
    bench.inputs(0, 5000)
    seqs = [b[4] for b in bench.after(104_000, EDGE)]
    assert seqs == [1, 0, 1, 0]
    bench.ask("06 00 00 00 00")
    assert {b[4] for b in bench.after(100_000, EDGE)} == {1}
    bench.ask("06 07 00 00 00")  # was not given yet
    assert {b[4] for b in bench.after(100_000, EDGE)} == {1}
    bench.ask("06 01 00 00 00")
    assert bench.after(1_000_000, EDGE) == []


def test_hello_forgets_edges_if_it_says_so():
    bench = quiet()
    bench.inputs(1)
    bench.after(10_000)
    bench.ask(HELLO)
    assert len(bench.after(100_000, EDGE)) > 0
    bench.ask("01 01 01 01")
    assert bench.after(500_000, EDGE) == []


def test_more_than_sixteen_edges_are_lost_with_an_alarm_that_ends():
    bench = quiet()
    bodies = []
    for k in range(20):
        bench.inputs((k + 1) % 2, 1000)
        bodies += bench.after(6000)
    assert {b[4] for b in bodies if b[0] == EDGE} == set(range(16))
    alarms = [b for b in bodies if b[0] == ALARM]
    assert [(a[1:5], a[5], a[13]) for a in alarms] == [
        (b"\xff\x01\x07\x00", n - 1, n) for n in (1, 2, 3, 4)
    ]
    bench.ask("06 0F 00 00 00")
    (cleared,) = bench.after(10, ALARM)
    assert (cleared[1:5], cleared[13]) == (b"\xff\x00\x07\x00", 4)
    bench.inputs(1)
    assert bench.after(6000, EDGE)[0][4] == 20


def test_what_is_latched_later_than_promised_is_marked():
    bench = quiet()
    bench.ask(START_1_KHZ)
    bench.latch_takes(4)
    (body,) = bench.after(1500, SAMPLE)
    assert body[-2:] == b"\x04\x04"
    ticks, count = struct.unpack_from("<II", body, 8)
    assert count == ticks + 4
    bench.latch_takes(3)
    assert bench.after(1000, SAMPLE)[0][-2:] == b"\x00\x00"


def test_alarms_of_the_port_wait_for_room():
    bench = quiet()
    bench.room(10)
    assert [bench.alarm(1, 1, 1, 350 + n) for n in range(5)] == [True] * 4 + [False]
    assert bench.after(100) == []
    bench.room(1000)
    bodies = bench.after(9002, ALARM)
    assert [struct.unpack_from("<IIi", b, 5)[0::2] for b in bodies] == [
        (n, 350 + n) for n in range(4)
    ]


@pytest.mark.needs("avr")
def test_it_compiles_for_a_processor_of_eight_bits(tmp_path):
    ran = run_program("make", "-C", FIRMWARE, "avr-core", f"BUILD={tmp_path}")
    (total,) = [li.split() for li in ran.stdout.splitlines() if "(TOTALS)" in li]
    assert int(total[0]) < 12_000  # bytes of flash
    assert total[1:3] == ["0", "0"]  # its state is the port's


@pytest.mark.needs("cppcheck")
def test_cppcheck_finds_nothing():
    run_program("make", "-C", FIRMWARE, "cppcheck")


def test_a_board_of_inputs_alone():
    bench = quiet(channels=0)
    bench.inputs(1)
    (body,) = bench.after(5000, EDGE)
    assert len(body) == 12
