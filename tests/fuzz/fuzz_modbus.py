"""Replies to Modbus requests, through pymodbus: none without its check sum."""

from pymodbus.exceptions import ModbusException

from tests.fuzz.chunks import chunks
from traverse.drivers.modbus.line import ModbusClient
from traverse.protocol.modbus import PositionRegisters

LONGEST = 48  # all frames that may be in it are looked at
SEEDS = tuple(
    bytes.fromhex(text)
    for text in (
        "03 01 04 04 00 01 E2 40 E3 14",
        "FF 01 04 02 13 C5 74 53",
        "00 01 84 02 C2 C1",
        "02 AA 01 04 04 00 01 E2 40 E3 14",
    )
)


def crc(data: bytes) -> bytes:
    """By the definition, bit by bit."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return value.to_bytes(2, "little")


class Said:
    """A port at which the bytes arrive in their chunks."""

    def __init__(self, data: bytes) -> None:
        self.left = list(chunks(data))

    def fileno(self) -> int:
        return -1

    def wait(self, seconds: float) -> bool:
        return bool(seconds and self.left)

    def read(self) -> bytes:
        return self.left.pop(0)

    def write(self, data: bytes) -> None:
        del data

    def close(self) -> None:
        self.left = []


class Clock:
    """Goes on each time it is looked at, so that waiting ends."""

    def __init__(self) -> None:
        self.now_ns = 0

    def __call__(self) -> int:
        self.now_ns += 1000
        return self.now_ns


def check(data: bytes) -> None:
    """Request two input registers of encoder 1; the bytes are the reply."""
    data = data[:LONGEST]
    client = ModbusClient(
        Said(data),
        Clock(),
        lambda _seconds: None,
        timeout_s=0.001,
        silence_s=0.0,
        echo=False,
    )
    try:
        reply = client.read_input_registers(0, count=2, device_id=1)
    except ModbusException:
        return
    heard = data[1:]
    frames = (
        heard[start : start + size]
        for start in range(len(heard))
        for size in range(4, len(heard) - start + 1)
    )
    assert any(crc(frame[:-2]) == frame[-2:] for frame in frames)
    if len(reply.registers) == 2:
        layout = PositionRegisters(0, 2, "high", True, 1.0, 1000)
        count = layout.count(reply.registers)
        assert count is None or 0 <= count < 1000
