"""The program as its users meet it: a process and a pty, spoken to in bytes."""

import json
import os
import select
import signal
import time
from contextlib import contextmanager

import pytest

from tests.simulator.conftest import config_text
from tests.simulator.processes import SPHERE, simulator

HELLO = bytes.fromhex("00 07 01 01 01 01 54 E6 00")
START_1_KHZ = bytes.fromhex("06 03 03 40 42 0F 03 4D 23 00")
STOP = bytes.fromhex("05 04 04 4F 91 00")


@contextmanager
def opened(folder):
    descriptor = os.open(folder / "port" / "base", os.O_RDWR | os.O_NOCTTY)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def read_until(descriptor, is_enough, limit_s=20.0):
    """Frames without delimiters, COBS undone, until there are enough."""
    bodies, rest, ends = [], b"", time.monotonic() + limit_s
    while not is_enough(bodies):
        assert time.monotonic() < ends, f"only {len(bodies)} frames"
        if not select.select([descriptor], [], [], 0.1)[0]:
            continue
        *segments, rest = (rest + os.read(descriptor, 65536)).split(b"\0")
        for data in segments:
            body, offset = bytearray(), 0
            while offset < len(data):
                body += data[offset + 1 : offset + data[offset]]
                offset += data[offset]
                body += b"\0" if offset < len(data) else b""
            bodies.append(bytes(body[:-2]))
    return bodies


def stop(process, folder):
    process.send_signal(signal.SIGTERM)
    assert process.wait(10.0) == 0
    lines = (folder / "truth.jsonl").read_text().splitlines()
    *edges, summary = [json.loads(line) for line in lines]
    return edges, summary


HEAD = 'start = "first_start"\ntruth_log = "truth.jsonl"'


@pytest.mark.parametrize("clock", ["real", "fast"])
def test_a_stream_with_its_edges(folder, clock):
    text = config_text(SPHERE, f'{HEAD}\nclock = "{clock}"')
    with simulator(folder, text) as process, opened(folder) as port:
        os.write(port, HELLO)
        read_until(port, lambda bodies: any(b[0] == 0x81 for b in bodies))
        os.write(port, START_1_KHZ)

        def is_enough(bodies):
            kinds = [body[0] for body in bodies]
            return kinds.count(0x83) >= 1500 and 0x84 in kinds

        bodies = read_until(port, is_enough)
        edges, summary = stop(process, folder)
    samples = [b for b in bodies if b[0] == 0x83]
    seqs = [int.from_bytes(b[4:8], "little") for b in samples]
    assert seqs == list(range(len(seqs)))
    assert summary["base"]["samples"] >= 1500
    assert summary["base"]["tx_dropped"] == 0
    edge = next(b for b in bodies if b[0] == 0x84)
    assert list(edge[12:40]) == [
        byte for count in edges[0]["counts"] for byte in count.to_bytes(4, "little")
    ]
    assert edges[0]["artefact"] == "sphere"
    distance = sum(
        (a - b) ** 2
        for a, b in zip(edges[0]["centre_mm"], [500.0, 100.0, 50.0], strict=True)
    )
    assert distance**0.5 == pytest.approx(28.4, abs=1e-9)


def test_a_host_that_does_not_read_loses_samples_and_is_told(folder):
    text = config_text(SPHERE, HEAD).replace(
        'port = "port/base"', 'port = "port/base"\ntransmit_buffer_bytes = 1024'
    )
    with simulator(folder, text) as process, opened(folder) as port:
        os.write(port, HELLO + START_1_KHZ)
        time.sleep(1.5)  # the host is busy elsewhere

        def is_enough(bodies):
            return any(b[0] == 0x86 and b[3] == 6 for b in bodies)

        bodies = read_until(port, is_enough)
        lines, summary = stop(process, folder)
    assert summary["base"]["tx_dropped"] > 100
    drops = [line for line in lines if line["event"] == "dropped"]
    assert drops[0]["device"] == "base"
    assert sum(drop["samples"] for drop in drops) == summary["base"]["tx_dropped"]
    seqs = [int.from_bytes(b[4:8], "little") for b in bodies if b[0] == 0x83]
    assert seqs == sorted(set(seqs))


def test_a_host_returns_and_says_hello_again(folder):
    with simulator(folder, config_text(SPHERE, HEAD)) as process:
        for _ in range(2):
            with opened(folder) as port:
                os.write(port, HELLO + START_1_KHZ)
                bodies = read_until(port, lambda b: len(b) > 100)
                hellos = [body for body in bodies if body[0] == 0x81]
                assert len(hellos) == 1
            time.sleep(0.2)
        stop(process, folder)


def test_a_board_that_is_removed_returns_with_another_boot_id(folder):
    fault = '[[fault]]\nkind = "gone"\nat_s = 0.3\nduration_s = 0.5\n'
    boot_ids = []
    with simulator(folder, config_text(SPHERE, HEAD, fault)) as process:
        link = folder / "port" / "base"
        for _ in range(2):
            with opened(folder) as port:
                os.write(port, HELLO + START_1_KHZ)
                bodies = read_until(port, lambda b: len(b) > 100)
                hello = next(body for body in bodies if body[0] == 0x81)
                boot_ids.append(hello[30:34])
                waiting = time.monotonic() + 10.0
                while link.is_symlink() and len(boot_ids) == 1:
                    assert time.monotonic() < waiting
                    time.sleep(0.01)
            while not link.is_symlink():
                assert time.monotonic() < waiting
                time.sleep(0.01)
        _, summary = stop(process, folder)
    assert boot_ids[0] != boot_ids[1]
    assert summary["base"]["power_ups"] == 2
