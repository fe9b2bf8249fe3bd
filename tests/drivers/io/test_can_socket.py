import socket
import struct

import pytest

from traverse.drivers.io.can_bus import FRAMES_LOST, SocketFrames


def frame(can_id: int, data: bytes) -> bytes:
    return struct.pack("=IB3x8s", can_id, len(data), data)


@pytest.fixture
def pair() -> tuple[socket.socket, socket.socket]:
    # As on a CAN socket, one read returns one frame.
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    with ours, theirs:
        yield ours, theirs


def test_frames_of_a_socket_are_split(
    pair: tuple[socket.socket, socket.socket],
) -> None:
    ours, theirs = pair
    frames = SocketFrames(ours, lambda: 7_000, lambda: 2_000)
    theirs.send(frame(0x185, b"\x40\xe2\x01\x00"))
    theirs.send(frame(0x080, b""))
    theirs.send(frame(0x8000_0185, bytes(4)))  # 29 bits
    theirs.send(frame(0x4000_0185, b""))  # remote
    theirs.send(b"short")
    theirs.send(frame(0x2000_0040, bytes(8)))  # the controller's own words
    got = [(can_id, data) for can_id, data, _ in frames.read(64)]
    assert got == [(0x185, b"\x40\xe2\x01\x00"), (0x080, b""), (0x2000_0040, bytes(8))]
    assert list(frames.read(64)) == []


def test_no_more_frames_are_read_than_asked_for(
    pair: tuple[socket.socket, socket.socket],
) -> None:
    ours, theirs = pair
    frames = SocketFrames(ours)
    for _ in range(5):
        theirs.send(frame(0x185, bytes(4)))
    assert [len(frames.read(2)) for _ in range(3)] == [2, 2, 1]


class StampedSocket:
    """A socket like the kernel's on CAN: with control messages."""

    def __init__(self, received: list[tuple[bytes, list[tuple[int, int, bytes]]]]):
        self._received = received

    def setsockopt(self, level: int, option: int, value: int) -> None:
        raise OSError("refused")

    def recvmsg(self, size: int, control: int, flags: int) -> object:
        del size, control, flags
        if not self._received:
            raise BlockingIOError
        data, messages = self._received.pop(0)
        return data, messages, 0, None


def test_the_kernels_stamp_is_brought_to_the_monotonic_clock() -> None:
    # Realtime is 1000 s ahead; the frame arrived 3 ns before it is read.
    stamp = (socket.SOL_SOCKET, 35, struct.pack("@ll", 1005, 999_999_997))
    lost = (socket.SOL_SOCKET, 40, struct.pack("@I", 12))
    port = StampedSocket([(frame(0x080, b""), [stamp, lost])])
    frames = SocketFrames(port, lambda: 6 * 10**9, lambda: 1006 * 10**9)  # type: ignore[arg-type]  # as much of a socket as is used
    assert frames.read(8) == [
        (FRAMES_LOST, b"", 6 * 10**9),
        (0x080, b"", 6 * 10**9 - 3),
    ]
    assert frames.dropped == 12
