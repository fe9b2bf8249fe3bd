"""`python -m benchmarks.service.plain_script PORT ARM DATABASE BROKER_PORT`: the peer.

A latch board's presses to MQTT, as a competent person writes it in an afternoon, with
what Traverse promises of a point: it is synced to the disk before the board may drop
the edge; it is sent until the broker has it, after a crash too; its id counts once.
"""

import json
import sqlite3
import time
import tomllib
import uuid
from binascii import crc_hqx
from collections import deque
from pathlib import Path

import numpy as np
import serial
from cobs import cobs
from paho.mqtt.client import Client, MQTTv5
from paho.mqtt.enums import CallbackAPIVersion

from benchmarks.tools.command_line import run_main


def frame(body: bytes) -> bytes:
    return cobs.encode(body + crc_hqx(body, 0xFFFF).to_bytes(2, "little")) + b"\0"


def turned(axis: np.ndarray, angle: float) -> np.ndarray:
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew


def main(port_path: str, arm_path: str, database_path: str, broker_port: str) -> None:
    arm = tomllib.loads(Path(arm_path).read_text())
    joints, probe = arm["joints"], arm["probe"]
    axes = np.array([joint["axis"] for joint in joints])
    links = np.array([joint["link_mm"] for joint in joints])
    links[-1] += probe["vector_mm"]
    zeros = np.array([joint["zero_rad"] for joint in joints])
    scale = [
        2 * np.pi * j["encoder"]["sign"] / j["encoder"]["counts_per_turn"]
        for j in joints
    ]
    base, n, session = np.array(arm["origin_mm"]), len(joints), uuid.uuid4().hex

    database = sqlite3.connect(database_path, isolation_level=None)
    database.execute("PRAGMA journal_mode = WAL")
    database.execute("PRAGMA synchronous = FULL")
    database.execute(
        "CREATE TABLE IF NOT EXISTS point (number INTEGER PRIMARY KEY, "
        "id TEXT UNIQUE, payload TEXT, sent INTEGER DEFAULT 0)"
    )
    waiting: dict[int, int] = {}  # the broker's number of a message: ours
    sent: deque[int] = deque()
    client = Client(
        CallbackAPIVersion.VERSION2, f"plain-{arm['name']}", protocol=MQTTv5
    )
    client.on_publish = lambda client, data, mid, *details: sent.append(mid)
    client.connect("127.0.0.1", int(broker_port))
    client.loop_start()
    topic = f"plain/{arm['name']}/point"
    for number, payload in database.execute(
        "SELECT number, payload FROM point WHERE sent = 0 ORDER BY number"
    ).fetchall():
        waiting[client.publish(topic, payload, 1).mid] = number

    board = serial.Serial(port_path, 1_000_000)
    board.write(frame(b"\x01\x01\x01\x01"))  # HELLO; forget older edges
    board.write(frame(b"\x02\x02\xff" + (500).to_bytes(2, "little") + bytes(6)))
    board.write(frame(b"\x03\x03" + (1000).to_bytes(4, "little")))  # START, 1 Hz
    rest, last_edge, seq = b"", -1, 0
    while True:
        *segments, rest = (rest + board.read(board.in_waiting or 1)).split(b"\0")
        for segment in filter(None, segments):
            body = cobs.decode(segment)
            if crc_hqx(body[:-2], 0xFFFF) != int.from_bytes(body[-2:], "little"):
                continue
            if body[0] != 0x84:  # no EDGE
                continue
            edge = int.from_bytes(body[4:8], "little")
            if body[2] and edge > last_edge:  # a press; releases are only acknowledged
                counts = np.frombuffer(body, "<u4", n, 12)
                angles = counts * scale
                place, turns = base.copy(), np.eye(3)
                for axis, link, angle in zip(axes, links, angles - zeros, strict=True):
                    turns = turns @ turned(axis, angle)
                    place = place + turns @ link
                point = {
                    "id": f"{session}-{seq}", "session": session, "seq": seq,
                    "time_ns": time.time_ns(), "xyz_mm": place.tolist(),
                    "ijk": (turns @ probe["direction"]).tolist(),
                    "angles_rad": angles.tolist(), "counts": counts.tolist(),
                    "status": list(body[12 + 4 * n : 12 + 5 * n]),
                }  # fmt: skip
                payload = json.dumps(point)
                database.execute("BEGIN IMMEDIATE")
                done = [(waiting.pop(sent.popleft()),) for _ in range(len(sent))]
                database.executemany("UPDATE point SET sent = 1 WHERE number = ?", done)
                inserted = database.execute(
                    "INSERT INTO point (id, payload) VALUES (?, ?)",
                    (point["id"], payload),
                )
                database.execute("COMMIT")  # synced; only now may the board drop it
                waiting[client.publish(topic, payload, 1).mid] = inserted.lastrowid or 0
                seq += 1
            last_edge = max(last_edge, edge)
            board.write(frame(b"\x06" + edge.to_bytes(4, "little")))


if __name__ == "__main__":
    run_main(main)
