import asyncio
import contextlib
import json
import os
import struct
import time
from contextlib import closing

import pytest

from tests.end_to_end.workbench import REST, Workbench
from tests.firmware.core_bench import opened
from tests.firmware.host_rig import HostBoard
from tests.protocol.latch_board_frames import framed
from tests.running import invoke
from traverse.drivers.io.serial_port import SerialPort
from traverse.drivers.latch_board.conformance import BoardTester
from traverse.testing.pty_peer import PtyPeer

CHECKS = [
    "HELLO and the identity", "answers within 100 ms", "another major version",
    "refusals", "garbage and resynchronisation", "CONFIGURE and heartbeats",
    "temperatures", "LATCH", "START, timed samples, STOP", "edges", "no broken frames",
]  # fmt: skip
HELLO = bytes.fromhex(
    "545241564552534500000007 010203 01 00 00 40420F00 80969800 EFBEADDE 18 00000000"
)


class WrongBoard(PtyPeer):
    """A board of a few lines that was written without reading the page to its end.

    Args:
        hello: its identity.
        spoilt: whether its CRCs are wrong.
    """

    def __init__(self, link, hello=HELLO, *, spoilt=False) -> None:
        super().__init__(link)
        self._hello, self._spoilt = hello, spoilt

    def _live(self) -> None:
        received = b""
        while self._plugged:
            with contextlib.suppress(OSError):
                received += os.read(self._master, 4096)
            *segments, received = received.split(b"\0")
            for body in filter(None, map(self._body, segments)):
                for answer in self._answers(body):
                    data = bytearray(framed(answer))
                    data[-2] ^= 0x20 * self._spoilt
                    os.write(self._master, data)
            time.sleep(0.002)

    def _body(self, segment: bytes) -> bytes:
        with contextlib.suppress(AssertionError, IndexError):
            return opened(segment)
        return b""

    def _answers(self, body: bytes) -> list[bytes]:
        kind, number = body[0], body[1]
        done = struct.pack("<BBBBI", 0x82, kind, number, 0, 0)
        latch = bytes(4) + struct.pack("<II", 100 * number, 5) + b"\0"
        match kind:
            case 1:  # of whatever major version
                return [bytes((0x81, number, 1, 0)) + self._hello]
            case 5:  # a REPLY besides
                return [bytes((0x83, 1, number, 0)) + latch, done]
            case 3:  # samples are counted from 1
                head = bytes((0x83, 0, number, 0))
                return [
                    done[:4] + body[2:6],
                    *(head + struct.pack("<IIIB", n, n, 5, 0) for n in range(1, 51)),
                ]
        return [done] if kind in (2, 4) else []


def failures(link) -> dict[str, dict[str, str]]:
    ran = invoke("board", "test", link, "--json", status=1)
    report = json.loads(ran.stdout)
    assert not report["passed"]
    return {check["name"]: check for check in report["checks"]}


def test_a_wrong_board_is_told_what_was_expected_and_what_came(tmp_path):
    with WrongBoard(tmp_path / "port") as board:
        checks = failures(board.link)
    assert list(checks) == CHECKS
    major = checks["another major version"]
    assert (major["section"], major["expected"]) == (2, "82 01 .. 04 01 00 00 00")
    assert major["came"].startswith("81 ")
    refusals = checks["refusals"]
    assert refusals["expected"].startswith("an answer to 1F ")
    assert "HEARTBEAT" in checks["CONFIGURE and heartbeats"]["expected"]
    assert checks["temperatures"]["result"] == "not tested"
    latch = checks["LATCH"]
    assert (latch["section"], latch["expected"]) == (2, "one SAMPLE alone for a LATCH")
    assert latch["came"].startswith("82 05 ")
    stream = checks["START, timed samples, STOP"]
    assert "00 00 00 00 01 00 00 00" in stream["expected"]
    assert "01 00 00 00 01 00 00 00" in stream["came"]
    assert checks["no broken frames"]["result"] == "pass"


def test_a_hello_of_another_length_ends_the_test(tmp_path):
    with WrongBoard(tmp_path / "port", HELLO[:-1]) as board:
        ran = invoke("board", "test", board.link, status=1)
    first, expected, came, end = ran.stdout.splitlines()
    assert first == "fail        HELLO and the identity (section 4)"
    words = "expected HELLO: 81 .. 01, 34 bytes, 5 more for each channel"
    assert expected.split() == words.split()
    assert came.split()[:4] == ["came", "81", "01", "01"]
    assert end == "1 check failed"


def test_frames_with_a_wrong_crc_are_no_answer(tmp_path):
    with WrongBoard(tmp_path / "port", spoilt=True) as board:
        checks = failures(board.link)
    first = checks["HELLO and the identity"]
    body = bytes.fromhex("81010100") + HELLO
    frame = bytearray(framed(body))
    frame[-2] ^= 0x20
    assert first["section"] == 1
    assert first["came"].endswith(f"CRC: {frame.hex(' ').upper()}")


def test_a_port_that_is_not_there(tmp_path):
    ran = invoke("board", "test", tmp_path / "none", status=3)
    assert "there is no such port" in ran.stderr


@pytest.mark.needs("compiler")
def test_the_firmware_passes_and_its_edges_are_repeated(tmp_path):
    wake_read, wake_write = os.pipe2(os.O_NONBLOCK)
    # Its counter wraps while the stream is tested.
    wrapping = ("--first-ticks", str(2**32 - 6_500_000))
    with (
        HostBoard(tmp_path / "port", *wrapping) as board,
        closing(SerialPort(str(board.link), 1_000_000, wake_read)) as port,
    ):
        tester = BoardTester(port, 5.0, lambda _text: board.toggle())
        results = list(tester.results())
    for descriptor in (wake_read, wake_write):
        os.close(descriptor)
    assert [(r.name, r.result) for r in results] == [(n, "pass") for n in CHECKS]


@pytest.mark.slow
async def test_the_simulated_board_passes(tmp_path):
    bench = Workbench(tmp_path, "127.0.0.1", 0)
    bench.write_simulator(REST)
    with bench.simulator() as simulator:
        await simulator.says("ready base")
        ran = await asyncio.to_thread(invoke, "board", "test", bench.pty, status=None)
        await simulator.stop()
    assert ran.exit_code == 0, ran.stdout
    assert ran.stdout.splitlines()[-1] == "pass"
