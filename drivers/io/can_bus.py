"""A CAN bus for one thread: frames as plain values, stamped with the host's clock.

python-can opens the bus. On SocketCAN frames are then read from the socket directly
(`SocketFrames`): the kernel's time stamp to the nanosecond, its count of lost frames,
and a fifth of the cost. From the kernel's headers: the 16 bytes of a frame and its
flags, the two control messages, and that a count of lost frames is reported with the
frame after them.
"""

import contextlib
import errno
import os
import select
import socket
import struct
import time
from collections.abc import Callable, Sequence
from typing import Any

import can
from can.interfaces.socketcan import SocketcanBus

from traverse.drivers.base.values import DeviceError, DeviceNotFoundError
from traverse.protocol.canopen.errors import ERROR_FLAG

FRAME = struct.Struct("=IB3x8s")  # identifier and flags, length, data
STAMP = struct.Struct("@ll")  # seconds, nanoseconds
LOST = struct.Struct("@I")
SO_RCVBUFFORCE, SO_TIMESTAMPNS, SO_RXQ_OVFL = 33, 35, 40
# The kernel doubles it and reckons 768 bytes a frame: over a second of a bus at its
# limit. It allows net.core.rmem_max at most, as delivered 70 ms, unless it is forced,
# which needs CAP_NET_ADMIN.
RECEIVE_BUFFER_BYTES = 4 << 20
CONTROL_BYTES = socket.CMSG_SPACE(STAMP.size) + socket.CMSG_SPACE(LOST.size)
FRAMES_LOST = 0x1_0000_0000  # no identifier: marks missing frames
EXTENDED, REMOTE = 0x8000_0000, 0x4000_0000
Frame = tuple[int, bytes | bytearray, int]
"""Identifier (with `ERROR_FLAG` for the controller's own words), data, instant [ns]."""

MOST_AT_ONCE = 64  # frames read before the caller may send again
BLIND_WAIT_S = 0.02  # of an interface that nothing else can wake
EXACTLY = 0x7FF | EXTENDED | REMOTE  # so the kernel looks it up in a table
FULL = {errno.ENOBUFS, None}  # of the queue; of the socket python-can has no number
FULL_TRIES, FULL_WAIT_S = 50, 0.001  # SocketCAN queues ten frames as it is delivered
SLCAN_WAIT_S = 0.1  # python-can waits 2 s, for boards that restart when opened


class SocketFrames:
    """Reads the frames of an open CAN_RAW socket; closed by its owner.

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
        """Return identifier, data and instant of at most ``most`` received frames.

        A loss is marked by a frame with `FRAMES_LOST`.

        Raises:
            OSError: the interface is down or has disappeared.
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


class PeriodicTask:
    """A frame that the kernel sends periodically."""

    def __init__(self, task: can.broadcastmanager.CyclicSendTaskABC) -> None:
        self._task = task

    def stop(self) -> None:
        with contextlib.suppress(can.CanError, OSError, ValueError):
            self._task.stop()


class CanBus:
    """An open bus.

    Args:
        interface: of python-can: "socketcan", "slcan", "udp_multicast", "virtual", ...
        channel: of that interface: "can0", "/dev/ttyACM0", ...
        bit_rate: of the bus; SocketCAN has its own from the network's configuration.
        wake_fd: a non-blocking pipe; bytes in it end `receive` early and are consumed.
        identifiers: to receive; the kernel drops the rest. Empty for everything.

    Raises:
        DeviceNotFoundError: there is no such bus, or it cannot be opened.
    """

    def __init__(
        self,
        interface: str,
        channel: str,
        bit_rate: int,
        *,
        wake_fd: int | None = None,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
        identifiers: Sequence[int] = (),
    ) -> None:
        self.name = f"{interface}:{channel}"
        self._now_ns = monotonic_ns
        self._wake_fd = wake_fd
        self._bus = _opened(interface, channel, bit_rate)
        self._socket: SocketFrames | None = None
        if isinstance(self._bus, SocketcanBus):
            if identifiers:
                self._bus.set_filters(
                    [{"can_id": i, "can_mask": EXACTLY} for i in identifiers]
                )
            self._socket = SocketFrames(self._bus.socket, monotonic_ns)
        self._fd = _descriptor(self._bus)

    @property
    def has_kernel_sync(self) -> bool:
        """Whether frames can be sent periodically without a thread of Python."""
        return self._socket is not None

    @property
    def dropped(self) -> int:
        return 0 if self._socket is None else self._socket.dropped

    def receive(self, timeout_s: float) -> Sequence[Frame]:
        """Return received frames; waits at most ``timeout_s``.

        Raises:
            DeviceError: the bus has disappeared.
        """
        try:
            if self._fd is not None and not self._ready(self._fd, timeout_s):
                return []
            if self._socket is not None:
                return self._socket.read(MOST_AT_ONCE)
            wait_s = min(timeout_s, BLIND_WAIT_S) if self._fd is None else 0.0
            return self._read(wait_s)
        except (can.CanError, OSError, ValueError) as error:
            raise self._lost_error(error) from error

    def send(self, can_id: int, data: bytes) -> None:
        """Send a frame; waits a little if the queue of the interface is full.

        Raises:
            DeviceError: the bus does not take it.
        """
        message = can.Message(arbitration_id=can_id, data=data, is_extended_id=False)
        for attempt in range(FULL_TRIES):
            try:
                self._bus.send(message)
            except can.CanOperationError as error:
                if error.error_code not in FULL or attempt == FULL_TRIES - 1:
                    raise self._lost_error(error) from error
                time.sleep(FULL_WAIT_S)  # the time of some frames on the bus
            except (can.CanError, OSError) as error:
                raise self._lost_error(error) from error
            else:
                return

    def send_periodically(self, can_id: int, period_s: float) -> PeriodicTask:
        """Make the kernel send an empty frame every ``period_s``.

        Raises:
            DeviceError: it cannot; the module can-bcm is missing, for example.
        """
        try:
            frame = can.Message(arbitration_id=can_id, is_extended_id=False)
            return PeriodicTask(self._bus.send_periodic(frame, period_s))
        except (can.CanError, OSError, ValueError) as error:
            raise self._lost_error(error) from error

    def close(self) -> None:
        with contextlib.suppress(can.CanError, OSError, ValueError):
            self._bus.shutdown()

    def _ready(self, fd: int, timeout_s: float) -> bool:
        waiting = [fd] if self._wake_fd is None else [fd, self._wake_fd]
        ready, _, _ = select.select(waiting, [], [], max(0.0, timeout_s))
        if self._wake_fd is not None and self._wake_fd in ready:
            with contextlib.suppress(BlockingIOError):
                os.read(self._wake_fd, 4096)
        return fd in ready

    def _read(self, wait_s: float) -> list[Frame]:
        frames: list[Frame] = []
        message = self._bus.recv(wait_s)
        now_ns = self._now_ns()
        while message is not None:
            if message.is_error_frame:
                flagged = message.arbitration_id | ERROR_FLAG
                frames.append((flagged, message.data, now_ns))
            elif not (message.is_extended_id or message.is_remote_frame):
                frames.append((message.arbitration_id, message.data, now_ns))
            if len(frames) >= MOST_AT_ONCE:
                break
            message = self._bus.recv(0)
        return frames

    def _lost_error(self, error: Exception) -> DeviceError:
        return DeviceError(
            f"the bus {self.name} failed: {error}",
            "check adapter, cable and power, and that the interface is up",
        )


def _opened(interface: str, channel: str, bit_rate: int) -> can.BusABC:
    options: dict[str, Any] = {}
    if interface != "socketcan":
        options["bitrate"] = bit_rate
    if interface == "slcan":
        options |= {"timeout": 0, "sleep_after_open": SLCAN_WAIT_S}
    try:
        return can.Bus(channel, interface, ignore_config=True, **options)
    except (can.CanError, OSError, ValueError, ImportError) as error:
        reason = getattr(error, "strerror", None) or error
        raise DeviceNotFoundError(
            f"cannot open the bus {interface}:{channel}: {reason}",
            _remedy(interface, channel),
        ) from error
    except NotImplementedError as error:
        known = ", ".join(sorted(can.VALID_INTERFACES))
        raise DeviceNotFoundError(
            f"python-can has no interface {interface!r}", f"expected one of {known}"
        ) from error


def _remedy(interface: str, channel: str) -> str:
    if interface == "socketcan":
        return (
            f"bring it up with its bit rate: ip link set {channel} up type can "
            "bitrate 1000000, or through systemd-networkd"
        )
    return "check the name of the channel, the cable, and the rights on the port"


def _descriptor(bus: can.BusABC) -> int | None:
    try:
        number = bus.fileno()
    except NotImplementedError:
        return None
    return number if number >= 0 else None
