"""Devices on serial lines, with a device that answers "0", "1" with a count.

When samples are dropped, and why.
A simulator that was suspended, on a busy computer, catches up piece by piece.
"""

import os
import select
import threading
import time
from contextlib import contextmanager

import pytest

from tests.simulator.devices.host_side import heard, hosts_of, opened
from tests.simulator.one_hinge import Notebook, mounted
from tests.simulator.test_process import HELLO, START_1_KHZ
from traverse.simulator.devices.device import make_device
from traverse.simulator.devices.latch_board.device import (
    DropCounter,
    LatchBoardTable,
    SimulatedLatchBoard,
)
from traverse.simulator.devices.serial_device import SerialDevice
from traverse.simulator.devices.serial_table import SerialTable
from traverse.simulator.devices.table import KINDS, DeviceTable, class_named
from traverse.simulator.pacing import MonotonicClock, live_real


class TellerTable(SerialTable):
    ports: tuple[str, ...] = ("teller",)


class Teller(SerialDevice):
    def __init__(self, table, mounting):
        super().__init__(table, mounting, table.ports)

    def power_up(self, now_s):
        self.woken_s = now_s

    def receive_byte(self, line, byte, at_s):
        channel = byte - ord("0")
        count, _ = self.latch(channel, at_s)
        self.say(line, count.to_bytes(2, "big"), at_s, channel)


@contextmanager
def teller(folder, *faults, **keys):
    table = TellerTable(kind="teller", id="t", **keys)
    mounting = mounted(folder, table, *faults)
    device = Teller(table, mounting)
    with hosts_of(device, *(folder / port for port in table.ports)) as hosts:
        yield device, hosts


def test_a_request_is_answered_at_once_with_what_is_true_then(tmp_path):
    with teller(tmp_path) as (device, (host,)):
        device.live(0.0)
        os.write(host, b"1")
        device.live(2.5)
        assert heard(host) == (3500).to_bytes(2, "big")
        assert device.mounting.notes.readings == [("t", 1, 2.5, 3500, 0)]
        assert device.totals()["samples"] == 1


def test_bytes_take_their_time_on_the_wire_and_in_the_adapter(tmp_path):
    keys = {"baud_rate": 10_000, "request_delay_s": 0.01, "reply_delay_s": 0.02}
    with teller(tmp_path, turnaround_s=0.1, **keys) as (device, (host,)):
        device.live(0.0)
        os.write(host, b"01")
        device.live(1.0)
        # a byte takes 1 ms: the requests have arrived at 1.011 and 1.012 s
        assert device.next_due_s(0.0) == pytest.approx(1.011)
        device.live(1.02)
        noted = device.mounting.notes.readings
        assert [reading[2] for reading in noted] == pytest.approx([1.011, 1.012])
        # answers leave after 0.1 s, one after the other, and take 2 ms and 0.02 s
        assert device.next_due_s(0.0) == pytest.approx(1.133)
        device.live(1.1329)
        assert heard(host) == b""
        device.live(1.1331)
        assert heard(host) == (1011).to_bytes(2, "big")
        device.live(device.next_due_s(0.0))
        assert heard(host) == (2012).to_bytes(2, "big")
        assert device.next_due_s(0.0) == float("inf")


def test_an_adapter_that_echoes_lets_the_host_hear_itself_first(tmp_path):
    with teller(tmp_path, echo=True) as (device, (host,)):
        device.live(0.0)
        os.write(host, b"0")
        device.live(1.0)
        assert heard(host) == b"0" + (1000).to_bytes(2, "big")


def test_one_encoder_may_be_silent_late_or_lost(tmp_path):
    faults = (
        {"kind": "silent", "channel": 0, "at_s": 1.0, "duration_s": 1.0},
        {"kind": "late", "channel": 1, "probability": 1.0, "delay_s": 0.5},
        {"kind": "lost", "channel": 0, "at_s": 3.0, "probability": 1.0},
    )
    with teller(tmp_path, *faults) as (device, (host,)):
        answers = []
        device.live(0.0)
        for now_s in (0.5, 1.5, 2.5, 3.5):
            os.write(host, b"0")
            device.live(now_s)
            answers.append(heard(host))
        assert [len(data) for data in answers] == [2, 0, 2, 0]
        os.write(host, b"1")
        device.live(4.0)
        assert heard(host) == b""
        assert device.next_due_s(0.0) == pytest.approx(4.5)
        device.live(4.5)
        assert heard(host) == (5000).to_bytes(2, "big")
        counts = device.totals()["faults"]
        assert (counts["silenced"], counts["late"], counts["lost"]) == (1, 1, 1)


def test_each_port_is_a_line_of_its_own_and_all_vanish_together(tmp_path):
    fault = {"kind": "gone", "at_s": 1.0, "duration_s": 1.0}
    ports = ("run/a", "run/b")
    with teller(tmp_path, fault, ports=ports) as (device, hosts):
        assert device.where == f"{tmp_path / 'run/a'} {tmp_path / 'run/b'}"
        device.live(0.0)
        os.write(hosts[1], b"0")
        device.live(0.5)
        assert [len(heard(host)) for host in hosts] == [0, 2]
        device.live(1.5)
        assert not (tmp_path / "run/a").exists()
        device.live(2.5)
        assert (tmp_path / "run/a").is_symlink()
        assert device.woken_s == 2.5
        assert device.totals()["power_ups"] == 2


def test_a_host_that_lets_go_gets_no_old_answers_when_it_returns(tmp_path):
    with teller(tmp_path, turnaround_s=0.5) as (device, hosts):
        device.live(0.0)
        os.write(hosts[0], b"0")
        device.live(0.1)
        os.close(hosts[0])
        device.live(0.2)
        hosts[0] = opened(tmp_path / "teller")
        device.live(0.3)
        device.live(1.0)
        assert heard(hosts[0]) == b""


def test_the_loop_wakes_when_a_new_host_writes(tmp_path):
    """Without a host the port is watched all the same: no timeout is waited for."""
    table = TellerTable(kind="teller", id="t")
    device = Teller(table, mounted(tmp_path, table))
    device.live(0.0)
    assert select.select(device.readers(), [], [], 0.0)[0] == []
    host = opened(tmp_path / "teller")
    os.write(host, b"0")
    assert select.select(device.readers(), [], [], 5.0)[0] != []
    device.live(1.0)
    assert heard(host) == (1000).to_bytes(2, "big")
    assert select.select(device.readers(), [], [], 0.0)[0] == []
    os.close(host)
    device.live(2.0)
    assert select.select(device.readers(), [], [], 0.0)[0] == []
    device.close()


def test_in_real_time_a_reading_is_between_request_and_answer(tmp_path):
    with teller(tmp_path, baud_rate=115200) as (device, (host,)):
        clock = MonotonicClock()
        sent_ns, got_ns, latched_ns = [], [], []

        def stopped():
            """The host's turn, in the same thread: the next request."""
            if heard(host):
                got_ns.append(time.monotonic_ns())
                latched_s = device.mounting.notes.readings[-1][2]
                latched_ns.append(clock.origin_ns + round(1e9 * latched_s))
            if len(got_ns) == len(sent_ns):
                sent_ns.append(time.monotonic_ns())
                os.write(host, b"0")
            return len(got_ns) == 20

        live_real([device], clock, device.mounting.clock, None, stopped)
    for sent, latched, got in zip(sent_ns, latched_ns, got_ns, strict=False):
        assert sent + 86_000 < latched < got - 173_000  # 1 byte and 2 bytes at 115200


def test_every_kind_in_the_table_can_be_made():
    for name, kind in KINDS.items():
        table = class_named(kind.table)
        assert issubclass(table, DeviceTable)
        assert DeviceTable.variant({"kind": name}) is table
        assert callable(class_named(kind.device))
    assert callable(make_device)


def test_drops_in_a_row_are_one_note_with_what_came_before_them():
    notes = Notebook()
    drops = DropCounter("base", notes)
    for now_s, n_dropped in ((1.0, 0), (3.5, 900), (3.6, 20), (3.7, 0), (3.8, 4)):
        drops.live(now_s)
        drops.count(n_dropped)
    assert [(*drop[:3], round(drop[3], 9)) for drop in notes.drops] == [
        ("base", 920, 3.5, 2.5)
    ]
    drops.finish()
    drops.finish()
    assert [drop[1] for drop in notes.drops] == [920, 4]


STOOD_S = 10.0


def test_a_host_that_reads_loses_nothing_to_it(tmp_path):
    table = LatchBoardTable(id="base", kind="latch-board", port="base")
    board = SimulatedLatchBoard(table, mounted(tmp_path, table))
    host = os.open(tmp_path / "base", os.O_RDWR | os.O_NOCTTY)
    board.live(0.001)  # it has detected its host
    os.write(host, HELLO + START_1_KHZ)
    board.live(0.002)
    board.live(0.003)  # it answers what it has read
    over = threading.Event()

    def read():
        while not over.is_set():
            if select.select([host], [], [], 0.01)[0]:
                os.read(host, 65_536)

    reading = threading.Thread(target=read)
    reading.start()
    board.live(STOOD_S)
    over.set()
    reading.join()
    totals = board.totals()
    os.close(host)
    board.close()
    assert abs(totals["samples"] - 1000 * STOOD_S) < 10
    assert totals["tx_dropped"] == 0
