"""A Modbus client of pymodbus that reads and writes through our port.

So the port is exclusive, can be polled together with the thread's wake-up, and the
times of requests and replies are known.
"""

import logging
from collections.abc import Callable

from pymodbus.client.base import ModbusBaseSyncClient
from pymodbus.framer import FramerType
from pymodbus.transport import CommParams, CommType

from traverse.drivers.io.ports import BytePort

MOST_BYTES = 256  # of a frame


class ModbusClient(ModbusBaseSyncClient):
    """One line with Modbus RTU devices.

    Args:
        port: open port; `close_port` closes it.
        timeout_s: for a whole reply; may be changed.

    Attributes:
        sent_ns: when the last request was about to be written.
        received_ns: when the last bytes of its reply were read.
    """

    _request = _heard = b""

    def __init__(
        self,
        port: BytePort,
        monotonic_ns: Callable[[], int],
        let_pass: Callable[[float], None],
        *,
        timeout_s: float,
        silence_s: float,
        echo: bool,
    ) -> None:
        line = CommParams(
            comm_type=CommType.SERIAL,
            handle_local_echo=echo,
            timeout_connect=timeout_s,
        )
        super().__init__(FramerType.RTU, 0, line, None, None, None)
        # Replies that fail are counted and reported by the driver, all in one place.
        logging.getLogger("pymodbus.logging").setLevel(logging.CRITICAL)
        self._port = port
        self._now_ns = monotonic_ns
        self._let_pass = let_pass
        self.timeout_s = timeout_s
        self._silence_ns = round(silence_s * 1e9)
        self.sent_ns = self.received_ns = monotonic_ns()
        self.unrequested_bytes = 0

    def connect(self) -> bool:
        return True

    def close(self) -> None:
        """Do nothing; `close_port` closes the port."""

    def close_port(self) -> None:
        self._port.close()

    def send(self, request: bytes, addr: tuple[str, int] | None = None) -> int:
        """Send a frame after the silence between frames."""
        del addr  # of network clients
        quiet_ns = self._now_ns() - max(self.sent_ns, self.received_ns)
        if quiet_ns < self._silence_ns:
            self._let_pass((self._silence_ns - quiet_ns) * 1e-9)
        if self._port.wait(0.0):
            self.unrequested_bytes += len(self._port.read())
        self._request, self._heard = request, b""
        self.sent_ns = self.received_ns = self._now_ns()
        self._port.write(request)
        return len(request)

    def recv(self, size: int | None) -> bytes:
        """Return the next bytes; none once the time for the reply is over."""
        del size  # a frame contains its own
        until_ns = self.sent_ns + round(self.timeout_s * 1e9)
        while (left_ns := until_ns - self._now_ns()) > 0:
            if self._port.wait(left_ns * 1e-9):
                data = self._port.read()
                self.received_ns = self._now_ns()
                self._heard = (self._heard + data)[:MOST_BYTES]
                return data
        return b""

    @property
    def is_echoed(self) -> bool:
        """The last request itself was heard, which begins no reply to it."""
        return bool(self._request) and self._heard.startswith(self._request)

    def discard_late_bytes(self, seconds: float) -> int:
        n_bytes = 0
        until_ns = self._now_ns() + round(seconds * 1e9)
        while (left_ns := until_ns - self._now_ns()) > 0:
            if self._port.wait(left_ns * 1e-9):
                n_bytes += len(self._port.read())
        self.unrequested_bytes += n_bytes
        return n_bytes
