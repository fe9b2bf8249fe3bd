"""Arms without a daemon, as seen by a broker: `... PORT N RATE_HZ SECONDS FILE`.

Each has a connection of its own, sends a block of a scan every 50 ms (as the daemon
does) and two points a second. At the end it writes how many of each it has sent.
"""

import json
import random
import select
import socket
import time
from pathlib import Path

import numpy as np

from benchmarks.tools.command_line import run_main
from benchmarks.tools.raw_mqtt import PUBLISH, RawClient, packet, text
from tests.protocol.message_examples import POINT
from traverse.protocol.encoding import encode
from traverse.protocol.messages import Scan

BLOCK_S = 0.05
POINT_S = 0.5
N_JOINTS = 7


class Publisher:
    """One arm's connection and counts of its messages."""

    def __init__(self, port: int, name: str, rate_hz: float) -> None:
        self.name = name
        self._client = RawClient(port, f"traverse-{name}")
        self._socket: socket.socket = self._client._socket  # noqa: SLF001 - of our own
        self._n_block = round(rate_hz * BLOCK_S)
        self._rate_hz = rate_hz
        self.scan_seq = self.point_seq = 0
        self.n_bytes = 0
        self.due_s = time.monotonic() + random.uniform(0.0, BLOCK_S)
        self._point_due_s = self.due_s

    def serve(self) -> None:
        self._send("scan", encode(self._block(), "msgpack"))
        self.scan_seq += self._n_block
        if time.monotonic() >= self._point_due_s:
            self._point_due_s += POINT_S
            point = POINT.model_copy(
                update={
                    "arm": self.name,
                    "seq": self.point_seq,
                    "id": f"{self.name}-{self.point_seq}",
                }
            )
            payload = encode(point, "msgpack")
            self._client.publish(f"traverse/{self.name}/point", self.point_seq, payload)
            self.n_bytes += len(payload)
            self.point_seq += 1
        self.due_s += BLOCK_S
        while select.select([self._socket], [], [], 0.0)[0]:  # the broker's answers
            self._socket.recv(4096)

    def _send(self, kind: str, payload: bytes) -> None:
        topic = text(f"traverse/{self.name}/{kind}")
        self._socket.sendall(packet(PUBLISH, 0, topic + payload))
        self.n_bytes += len(payload)

    def _block(self) -> Scan:
        n = self._n_block
        turns = (self.scan_seq + np.arange(n)[:, np.newaxis]) * 1e-3
        angles = np.asarray(turns + np.arange(N_JOINTS), np.float64)
        return Scan(
            session="fleet",
            scan="fleet",
            seq=self.scan_seq,
            arm=self.name,
            model="0" * 64,
            mode="time",
            rate_hz=self._rate_hz,
            probe_radius_mm=3.0,
            time_ns=time.time_ns(),
            dtime_ns=np.arange(n, dtype=np.int64) * round(1e9 / self._rate_hz),
            xyz_mm=500.0 * np.sin(angles[:, :3]),
            ijk=np.cos(angles[:, :3]),
            angles_rad=angles,
            counts=np.round(angles * 1e6).astype(np.int64),
            part_xyz_mm=None,
            covariance_mm2=np.zeros((n, 6)),
            quality=np.zeros(n, np.uint32),
            dropped=0,
            lost=0,
            in_doubt=0,
            last=False,
            total=None,
        )


def main(port: int, n_arms: int, rate_hz: float, seconds: float, file: Path) -> None:
    arms = [Publisher(port, f"arm-{k:03d}", rate_hz) for k in range(n_arms)]
    end_s = time.monotonic() + seconds
    latest_s = 0.0
    while (now_s := time.monotonic()) < end_s:
        due = [arm for arm in arms if arm.due_s <= now_s]
        for arm in due:
            latest_s = max(latest_s, now_s - arm.due_s)
            arm.serve()
        if not due:
            time.sleep(max(0.0, min(arm.due_s for arm in arms) - time.monotonic()))
    time.sleep(0.5)  # the last answers
    sent = {arm.name: {"scan": arm.scan_seq, "point": arm.point_seq} for arm in arms}
    n_bytes = sum(arm.n_bytes for arm in arms)
    totals = {"sent": sent, "bytes": n_bytes, "latest_s": latest_s}
    file.write_text(json.dumps(totals), "utf-8")


if __name__ == "__main__":
    run_main(main)
