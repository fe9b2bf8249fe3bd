"""Frames read from a SocketCAN socket, with what the kernel knows of them.

Certain from the kernel's headers: the 16 bytes of a frame and its flags, the two
control messages, and that a count of lost frames comes with the frame after them.
"""

import contextlib
import socket
import struct
import time
from collections.abc import Callable

FRAME = struct.Struct("=IB3x8s")  # identifier and flags, length, data
STAMP = struct.Struct("@ll")  # seconds, nanoseconds
LOST = struct.Struct("@I")
SO_RCVBUFFORCE, SO_TIMESTAMPNS, SO_RXQ_OVFL = 33, 35, 40
# The kernel doubles it and reckons 768 bytes a frame: over a second of a bus at its
# limit. It gives net.core.rmem_max at most, as delivered 70 ms, unless it is forced,
# which needs CAP_NET_ADMIN.
RECEIVE_BUFFER_BYTES = 4 << 20
CONTROL_BYTES = socket.CMSG_SPACE(STAMP.size) + socket.CMSG_SPACE(LOST.size)
FRAMES_LOST = 0x1_0000_0000  # no identifier: stands where frames are missing
EXTENDED, REMOTE = 0x8000_0000, 0x4000_0000


class SocketFrames:
    """Reads the frames of an open CAN_RAW socket; whoever opened it closes it.

    Args:
        port: the socket.
        monotonic_ns: the host's clock, to which the kernel's stamps are brought.
        realtime_ns: the clock of those stamps.

    Attributes:
        dropped: frames for which the socket's buffer had no room.
    """

    def __init__(
        self,
        port: socket.socket,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        realtime_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._port = port
        self._now_ns, self._realtime_ns = monotonic_ns, realtime_ns
        self.dropped = 0
        for option, value in (
            (socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES),
            (SO_RCVBUFFORCE, RECEIVE_BUFFER_BYTES),
            (SO_TIMESTAMPNS, 1),
            (SO_RXQ_OVFL, 1),
        ):
            with contextlib.suppress(OSError):  # what is refused is done without
                port.setsockopt(socket.SOL_SOCKET, option, value)

    def read(self, most: int) -> list[tuple[int, bytes, int]]:
        """Identifier, data and instant of at most ``most`` frames that have come.

        Before the first frame after a loss stands one with `FRAMES_LOST`.

        Raises:
            OSError: the interface is down or gone.
        """
        frames: list[tuple[int, bytes, int]] = []
        receive, unpack = self._port.recvmsg, FRAME.unpack
        now_ns = self._now_ns()
        to_monotonic_ns = now_ns - self._realtime_ns()
        while len(frames) < most:
            try:
                data, control, _, _ = receive(
                    FRAME.size, CONTROL_BYTES, socket.MSG_DONTWAIT
                )
            except BlockingIOError:
                break
            if len(data) != FRAME.size:
                continue
            can_id, length, content = unpack(data)
            if can_id & (EXTENDED | REMOTE):
                continue
            at_ns = now_ns
            for level, kind, value in control:
                if level != socket.SOL_SOCKET:
                    continue
                if kind == SO_TIMESTAMPNS:
                    seconds, nanoseconds = STAMP.unpack_from(value)
                    at_ns = seconds * 10**9 + nanoseconds + to_monotonic_ns
                elif kind == SO_RXQ_OVFL:
                    (dropped,) = LOST.unpack_from(value)
                    if dropped != self.dropped:
                        self.dropped = dropped
                        frames.append((FRAMES_LOST, b"", now_ns))
            frames.append((can_id, content[:length], at_ns))
        return frames
