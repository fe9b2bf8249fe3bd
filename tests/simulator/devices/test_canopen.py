"""Simulated CANopen encoders, queried with bytes written by hand, in virtual time."""

import itertools
import os
import select
import tty

import can
import canopen
import pytest

from tests.simulator.one_hinge import mounted
from traverse.simulator.devices.canopen.device import CanOpenBus
from traverse.simulator.devices.canopen.slcan_adapter import SlcanAdapter
from traverse.simulator.devices.canopen.table import CanOpenTable

names = itertools.count()


class Bench:
    """Encoders and a host on a virtual bus; time advances on the test's command."""

    def __init__(self, folder, *faults, **keys):
        channel = f"sim-{next(names)}"
        table = CanOpenTable(
            kind="canopen", id="can", interface="virtual", channel=channel, **keys
        )
        self.host = can.Bus(channel, "virtual", ignore_config=True)
        self.mounting = mounted(folder, table, *faults)
        self.device = CanOpenBus(table, self.mounting)
        self.now_s = 0.0

    def tell(self, can_id, data=""):
        message = can.Message(
            arbitration_id=can_id, data=bytes.fromhex(data), is_extended_id=False
        )
        self.host.send(message)
        return self.at(self.now_s)

    def at(self, now_s):
        self.now_s = now_s
        self.device.live(now_s)
        heard = []
        while (message := self.host.recv(0)) is not None:
            heard.append(
                f"{message.arbitration_id:03X} {message.data.hex(' ')}".upper()
            )
        return [frame.strip() for frame in heard]

    def close(self):
        self.device.close()
        self.host.shutdown()


@pytest.fixture
def bench(tmp_path):
    made = []

    def make(*faults, **keys):
        made.append(Bench(tmp_path, *faults, nodes=(5, 9), **keys))
        made[-1].at(0.0)
        return made[-1]

    yield make
    for opened in made:
        opened.close()


PORTABLE = [  # what a host writes to have the position at every SYNC
    "23 00 18 01 85 01 00 80",
    "2F 00 18 02 01 00 00 00",
    "2F 00 1A 00 00 00 00 00",
    "23 00 1A 01 20 00 04 60",
    "2F 00 1A 00 01 00 00 00",
    "23 00 18 01 85 01 00 00",
]


def started(bench, *faults, **keys):
    nodes = bench(*faults, **keys)
    for request in PORTABLE:
        (answer,) = nodes.tell(0x605, request)
        assert answer == "585 60 " + request[3:11] + " 00 00 00 00"
    nodes.tell(0x000, "01 05")
    return nodes


def test_they_boot_answer_and_count_at_syncs(bench):
    nodes = started(bench)
    assert nodes.tell(0x605, "40 00 10 00 00 00 00 00") == [
        "585 43 00 10 00 96 01 01 00"
    ]
    nodes.now_s = 2.5
    first = nodes.tell(0x080)
    assert first == ["185 C4 09 00 00"]  # 2500; the other was not started
    assert nodes.mounting.notes.readings == [("can", 0, 2.5, 2500, 0)]


def test_boot_up_is_said_at_power_up(tmp_path):
    channel = "boot"
    host = can.Bus(channel, "virtual", ignore_config=True)
    table = CanOpenTable(
        kind="canopen", id="c", interface="virtual", channel=channel, nodes=(5, 9)
    )
    device = CanOpenBus(table, mounted(tmp_path, table))
    heard = [host.recv(0) for _ in range(2)]
    assert [(m.arbitration_id, bytes(m.data)) for m in heard] == [
        (0x705, b"\0"),
        (0x709, b"\0"),
    ]
    device.close()
    host.shutdown()


def test_refusals_have_their_codes(bench):
    nodes = bench()
    # read only; no such object; no such sub-index; wrong length
    assert nodes.tell(0x605, "23 04 60 00 01 00 00 00") == [
        "585 80 04 60 00 02 00 01 06"
    ]
    assert nodes.tell(0x605, "40 99 60 00 00 00 00 00") == [
        "585 80 99 60 00 00 00 02 06"
    ]
    assert nodes.tell(0x605, "40 18 10 09 00 00 00 00") == [
        "585 80 18 10 09 11 00 09 06"
    ]
    assert nodes.tell(0x605, "2F 17 10 00 64 00 00 00") == [
        "585 80 17 10 00 10 00 07 06"
    ]


def test_network_management_and_heartbeat(bench):
    nodes = bench()
    nodes.tell(0x605, "2B 17 10 00 64 00 00 00")  # 100 ms
    assert nodes.at(0.09) == []
    assert nodes.at(0.11) == ["705 7F"]
    nodes.tell(0x000, "01 05")
    assert nodes.at(0.21) == ["705 05"]
    nodes.tell(0x000, "02 00")
    assert nodes.at(0.31) == ["705 04"]
    assert nodes.tell(0x605, "40 00 10 00 00 00 00 00") == []  # stopped: NMT only
    assert nodes.tell(0x000, "81 05") == ["705 00"]
    assert nodes.at(1.0) == []  # its heartbeat time was not stored


def test_what_is_stored_outlives_a_reset(bench):
    nodes = bench()
    nodes.tell(0x605, "2B 17 10 00 64 00 00 00")
    assert nodes.tell(0x605, "23 10 10 01 73 61 76 65") == [
        "585 60 10 10 01 00 00 00 00"
    ]
    nodes.tell(0x000, "81 05")
    assert nodes.tell(0x605, "40 17 10 00 00 00 00 00") == [
        "585 4B 17 10 00 64 00 00 00"
    ]
    refused = nodes.tell(0x605, "23 10 10 01 00 00 00 00")
    assert refused == ["585 80 10 10 01 30 00 09 06"]


def test_a_preset_makes_the_position_what_it_says(bench):
    nodes = bench()
    nodes.tell(0x605, "23 03 60 00 40 02 00 00")
    assert nodes.tell(0x605, "40 04 60 00 00 00 00 00") == [
        "585 43 04 60 00 40 02 00 00"
    ]


def test_the_event_timer_sends_by_itself(bench):
    nodes = bench()
    nodes.tell(0x605, "2B 00 62 00 0A 00 00 00")  # 10 ms; type 254 as delivered
    nodes.tell(0x000, "01 05")
    assert nodes.device.next_due_s(0.0) <= 0.01
    n = sum(len(nodes.at(0.005 * k)) for k in range(1, 21))
    assert n == 10


def test_layer_setting_in_bytes(bench):
    nodes = bench()
    assert nodes.tell(0x7E5, "5E 00 00 00 00 00 00 00") == []
    # selected by vendor, product, revision and serial number of the second
    nodes.tell(0x7E5, "40 53 00 00 00 00 00 00")
    nodes.tell(0x7E5, "41 01 00 96 01 00 00 00")
    nodes.tell(0x7E5, "42 00 00 01 00 00 00 00")
    assert nodes.tell(0x7E5, "43 E9 03 00 00 00 00 00") == ["7E4 44" + " 00" * 7]
    assert nodes.tell(0x7E5, "5E" + " 00" * 7) == ["7E4 5E 09" + " 00" * 6]
    assert nodes.tell(0x7E5, "5D" + " 00" * 7) == ["7E4 5D E9 03 00 00 00 00 00"]
    assert nodes.tell(0x7E5, "11 14" + " 00" * 6) == ["7E4 11" + " 00" * 7]
    assert nodes.tell(0x7E5, "11 80" + " 00" * 6) == ["7E4 11 01" + " 00" * 6]
    assert nodes.tell(0x7E5, "13 00 03" + " 00" * 5) == ["7E4 13" + " 00" * 7]
    assert nodes.tell(0x7E5, "13 00 05" + " 00" * 5) == ["7E4 13 01" + " 00" * 6]
    assert nodes.tell(0x7E5, "17" + " 00" * 7) == ["7E4 17" + " 00" * 7]
    nodes.tell(0x7E5, "04 00" + " 00" * 6)
    assert nodes.tell(0x7E5, "5E" + " 00" * 7) == []


def fault(kind, **keys):
    return {"kind": kind, "at_s": 1.0, "duration_s": 1.0} | keys


def test_an_emergency_begins_and_ends_with_its_alarm(bench):
    nodes = started(bench, fault("emcy", channel=0))
    nodes.tell(0x080)
    assert nodes.at(0.9) == []
    assert nodes.at(1.1) == ["085 00 10 01 01 00 00 00 00"]
    assert nodes.tell(0x605, "40 03 65 00 00 00 00 00") == [
        "585 4B 03 65 00 01 00 00 00"
    ]
    assert nodes.at(2.1) == ["085" + " 00" * 8]
    assert nodes.tell(0x605, "40 03 65 00 00 00 00 00") == [
        "585 4B 03 65 00 00 00 00 00"
    ]


def test_a_reset_forgets_and_boots(bench):
    nodes = started(bench, fault("reset", channel=0))
    nodes.tell(0x080)
    nodes.at(1.1)
    assert nodes.tell(0x080) == []
    assert nodes.at(2.1) == ["705 00"]
    assert nodes.tell(0x605, "40 00 18 02 00 00 00 00") == [
        "585 4F 00 18 02 FE 00 00 00"
    ]


def test_silence_duplicates_and_delays(bench):
    nodes = started(
        bench,
        fault("silent", channel=0),
        fault("duplicate", channel=0, at_s=3.0),
        fault("late", channel=0, at_s=5.0, probability=1.0, delay_s=0.01),
    )
    assert len(nodes.tell(0x080)) == 1
    nodes.now_s = 1.5
    assert nodes.tell(0x080) == []
    nodes.now_s = 3.5
    first, second = nodes.tell(0x080)
    assert first == second
    nodes.now_s = 5.5
    assert nodes.tell(0x080) == []
    assert len(nodes.at(5.511)) == 1


def test_a_bus_that_is_off_says_so_and_is_silent(bench):
    nodes = started(bench, fault("bus_off"))
    nodes.tell(0x080)
    assert nodes.at(1.1)[0].startswith("040 ")
    assert nodes.tell(0x605, "40 00 10 00 00 00 00 00") == []
    assert nodes.at(2.1)[0].startswith("100 ")
    assert len(nodes.tell(0x605, "40 00 10 00 00 00 00 00")) == 1


def test_an_encoder_that_says_another_resolution(bench):
    nodes = bench(told_counts_per_turn=(4096, 8192))
    assert nodes.tell(0x605, "40 01 65 00 00 00 00 00") == [
        "585 43 01 65 00 00 10 00 00"
    ]


def test_the_library_can_ask_them(bench):
    nodes = bench()

    class Asked(canopen.Network):
        def send_message(self, can_id, data, remote=False):
            for frame in nodes.tell(can_id, bytes(data).hex()):
                answer = bytes.fromhex(frame[4:])
                self.notify(int(frame[:3], 16), bytearray(answer), 0.0)

    network = Asked()
    node = network.add_node(9, canopen.ObjectDictionary())
    assert node.sdo.upload(0x1008, 0) == b"simulated encoder"
    assert int.from_bytes(node.sdo.upload(0x1018, 4), "little") == 1001


@pytest.mark.parametrize(
    ("keys", "word"),
    [
        ({"interface": "slcan", "channel": "x"}, "port"),
        ({"interface": "virtual", "port": "x"}, "channel"),
    ],
)
def test_a_bus_is_at_one_place(keys, word):
    with pytest.raises(ValueError, match=f"needs the key {word}"):
        CanOpenTable(kind="canopen", id="c", **keys)


class TestSlcan:
    @pytest.fixture
    def adapter(self, tmp_path):
        made = SlcanAdapter(tmp_path / "slcan")
        self.host = os.open(made.where, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self.host)
        yield made
        os.close(self.host)
        made.close()

    def talk(self, adapter, data, answer):
        """Send it a setting; return the frames it takes, once it has replied."""
        os.write(self.host, data)
        frames, heard = adapter.receive(), b""
        while len(heard) < len(answer):
            assert select.select([self.host], [], [], 2.0)[0], heard
            heard += os.read(self.host, 4096)
        assert heard == answer
        return frames

    def test_frames_go_both_ways_while_it_is_open(self, adapter):
        assert self.talk(adapter, b"t0800\r", b"\a") == []
        assert self.talk(adapter, b"S8\r", b"\r") == []
        assert self.talk(adapter, b"O\r", b"\r") == []
        assert self.talk(adapter, b"t0800\r", b"z\r") == [(0x080, b"")]
        assert self.talk(adapter, b"t6058400010", b"") == []
        request = (0x605, bytes.fromhex("4000100000000000"))
        assert self.talk(adapter, b"0000000000\r", b"z\r") == [request]
        adapter.send(0x185, b"\x40\xe2\x01\x00")
        assert self.talk(adapter, b"V\r", b"t185440E20100\rV1013\r") == []
        assert self.talk(adapter, b"C\r", b"\r") == []
        assert self.talk(adapter, b"t0800\r", b"\a") == []

    def test_what_it_does_not_know_is_answered_with_a_bell(self, adapter):
        for line in (b"S9x\r", b"t08\r", b"t9990\r", b"t18540\r", b"?\r", b"tzzz0\r"):
            assert self.talk(adapter, line, b"\a") == []
        assert adapter.n_rejected == 6
        assert self.talk(adapter, b"F\r", b"F00\r") == []
