"""A virtual CAN interface of the kernel, and raw frames put on it by hand."""

import contextlib
import re
import socket
import struct
import subprocess
from pathlib import Path

NAME = "vcan0"
FRAME = struct.Struct("=IB3x8s")
PROC = Path("/proc/net")


def ip(*words: str) -> None:
    subprocess.run(["ip", "link", *words], check=True)


def add() -> None:
    ip("add", NAME, "type", "vcan")
    ip("set", NAME, "up")


def open_raw() -> socket.socket:
    port = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    port.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, b"")
    port.bind((NAME,))
    return port


def listen(*can_ids: int) -> socket.socket:
    exact = 0xC000_07FF
    port = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    expected = b"".join(struct.pack("=II", i, exact) for i in can_ids)
    port.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, expected)
    port.bind((NAME,))
    return port


def send(port: socket.socket, can_id: int, data: bytes) -> None:
    port.send(FRAME.pack(can_id, len(data), data))


def exact_receivers() -> set[int]:
    """Identifiers that sockets have requested from the kernel, one by one."""
    lines = (PROC / "can/rcvlist_sff").read_text().splitlines()
    words = [line.split() for line in lines]
    return {int(w[1], 16) for w in words if w and w[0] == NAME}


def periodic_frames() -> int:
    """Number of frames that the kernel's broadcast manager reports as sent."""
    n_sent = 0
    for path in (PROC / "can-bcm").iterdir():
        with contextlib.suppress(FileNotFoundError):  # closed since it was listed
            counts = re.findall(
                r"^tx_op: .* sent (\d+)", path.read_text(), re.MULTILINE
            )
            n_sent += sum(map(int, counts))
    return n_sent
