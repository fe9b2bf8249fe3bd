import json
import math
import os
import select
import signal
import time

from tests.simulator.conftest import config_text, seven_text
from tests.simulator.processes import SPHERE, simulator

PORTS = [f"port/{number}" for number in range(7)]


def test_the_truth_log_tells_what_was_latched_when(folder):
    (folder / "arm.toml").write_text(seven_text().replace("8388608", "262144"))
    head = 'truth_log = "truth.jsonl"\ntruth_readings = true\nstart = "first_start"'
    keys = f'kind = "rls"\nports = {PORTS}\nbits = 18'
    text = config_text(SPHERE, head).replace('port = "port/base"', keys)
    with simulator(folder, text, PORTS) as process:
        answers = [ask(folder / PORTS[k % 7], b"1", 4) for k in range(70)]
        process.send_signal(signal.SIGTERM)
        assert process.wait(10.0) == 0
    *readings, summary = map(
        json.loads, (folder / "truth.jsonl").read_text("utf-8").splitlines()
    )
    assert summary["base"]["samples"] == len(readings) == 70
    for number, (reading, (sent_ns, reply, got_ns)) in enumerate(
        zip(readings, answers, strict=True)
    ):
        channel = number % 7
        assert (reading["event"], reading["channel"]) == ("reading", channel)
        # Two clocks read at different moments agree on an instant this well only.
        assert sent_ns - 1e6 < reading["monotonic_ns"] < got_ns + 1e6
        assert reply[0] == ord("1")
        assert int.from_bytes(reply[1:], "big") >> 6 == reading["count"]
        counts = reading["angles_rad"][channel] * 262144 / math.tau * (-1) ** channel
        assert (reading["count"] - round(counts) + 1) % 262144 <= 2
    assert readings[0]["script_s"] == 0.0
    assert readings[-1]["script_s"] > 0.0


def ask(port, request, n_bytes):
    descriptor = os.open(port, os.O_RDWR | os.O_NOCTTY)
    try:
        sent_ns, reply = time.monotonic_ns(), b""
        os.write(descriptor, request)
        while len(reply) < n_bytes:
            assert select.select([descriptor], [], [], 10.0)[0], reply
            reply += os.read(descriptor, n_bytes)
        return sent_ns, reply, time.monotonic_ns()
    finally:
        os.close(descriptor)
