"""What a board says of itself: its properties, and its alarms."""

from traverse.drivers.base.values import DeviceAlarm, DeviceRefusedError, Identity
from traverse.protocol.latch_board import messages as wire

JITTER_NS = 50_000  # of the mapped time, and from an edge to a latch that is not late
MIN_TICK_RATE_HZ, MAX_TICK_RATE_HZ = 100_000, 100_000_000

REMEDIES = {
    1: "clean the encoder's scale; check its distance, its plug and its supply",
    2: "do not measure; clean the encoder's scale, check its plug and its supply",
    3: "move slower; then touch a known point before you measure on",
    4: "check the supply of the board and its cable",
    5: "wait until the board is as warm as it may be; check its cooling",
    6: "lower the rate, or raise baud_rate of the device",
    7: "press again: these presses took no points",
    8: "check the encoder's plug and cable",
}
"""Remedies for alarms of the board; texts are in `wire.ALARMS`."""


def check_identification(hello: wire.Hello, path: str) -> None:
    """Refuse a board with contradictory properties.

    Raises:
        DeviceRefusedError: another version, impossible channels or counter.
    """
    if hello.version[0] != wire.MAJOR:
        raise DeviceRefusedError(
            f"the board on {path} speaks version {hello.version[0]} of its "
            f"protocol, this driver version {wire.MAJOR}",
            "update the board's firmware or this program",
        )
    if not all(1 <= c.bits <= 32 for c in hello.channels):
        raise DeviceRefusedError(
            f"the board on {path} describes impossible channels: {hello.channels}",
            "update the board's firmware",
        )
    if not hello.channels and not hello.n_inputs:
        raise DeviceRefusedError(
            f"the board on {path} has neither channels nor inputs",
            "update the board's firmware",
        )
    if not MIN_TICK_RATE_HZ <= hello.tick_rate_hz <= MAX_TICK_RATE_HZ:
        raise DeviceRefusedError(
            f"the counter of the board on {path} runs at {hello.tick_rate_hz} Hz, "
            f"expected {MIN_TICK_RATE_HZ} to {MAX_TICK_RATE_HZ} Hz",
            "update the board's firmware",
        )


def board_identity(hello: wire.Hello) -> Identity:
    return Identity(
        f"latch board {hello.board_id.hex()}",
        ".".join(map(str, hello.firmware)),
        tuple(channel.modulus for channel in hello.channels),
        hello.n_inputs,
        hello.max_rate_hz if hello.channels else 0.0,
        latches=bool(hello.channels),
        jitter_ns=JITTER_NS,
        boot=f"{hello.boot_id:x}",
        # Bytes that are all the same were never written.
        serials=(hello.board_id.hex() if len({*hello.board_id}) > 1 else "",),
    )


def device_alarm(device: str, alarm: wire.Alarm) -> DeviceAlarm:
    channel = None if alarm.channel == wire.WHOLE_BOARD else alarm.channel
    text = wire.ALARMS.get(alarm.code, f"maker's alarm {alarm.code}")
    return DeviceAlarm(
        device,
        channel,
        alarm.raised,
        alarm.code,
        text,
        alarm.value,
        REMEDIES.get(alarm.code, "look the number up in the manual of the board"),
    )
