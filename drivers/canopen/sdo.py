"""SDO transfers of the `canopen` library that read the bus while they wait.

The library waits for an answer on a queue that a thread of its own fills. Here the
thread that owns the bus waits by reading it, so that positions and heartbeats are
processed during a transfer, and no second thread touches the bus.
"""

import time
from collections import deque
from collections.abc import Callable

from canopen import ObjectDictionary, SdoAbortedError, SdoCommunicationError
from canopen.network import Network
from canopen.sdo.client import SdoClient

from traverse.drivers.base.values import DeviceError
from traverse.drivers.io.can_bus import CanBus
from traverse.protocol.canopen import frames as wire
from traverse.protocol.canopen.objects import ABORTS

SHORT_WAIT_S = 0.01
LATEST_NS = 5_000_000_000  # after its request no answer arrives any more
ABORTED = 0x80
BEGINNINGS = (0x20, 0x40)  # of a transfer: the request names its object


class NodeError(DeviceError):
    """A node did not answer, or refused."""


class NodeRefusedError(NodeError):
    """A node aborted a transfer.

    Attributes:
        code: reason, see `traverse.protocol.canopen.objects.ABORTS`.
    """

    def __init__(self, text: str, remedy: str, code: int) -> None:
        super().__init__(text, remedy)
        self.code = code


class _Wire(Network):
    """The part of the library's network that a transfer needs: sending."""

    def __init__(self, bus: CanBus) -> None:
        super().__init__()
        self._can_bus = bus

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        del remote  # never requested by a transfer
        self._can_bus.send(can_id, bytes(data))


class NodeSdo(SdoClient):
    """Reads and writes objects of one node.

    Args:
        poll_bus: reads the bus once, waiting at most the given time [s], and passes
            replies of this node to `take`.
        stopping: polled while waiting; True ends the transfer.
        answer_s: time limit of an answer.

    Attributes:
        surplus: answers without a request: two nodes have the same number. Late
            answers of a slow node to an earlier try do not count.
    """

    def __init__(
        self,
        node: int,
        bus: CanBus,
        poll_bus: Callable[[float], None],
        *,
        stopping: Callable[[], bool],
        answer_s: float,
        tries: int,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        super().__init__(  # type: ignore[no-untyped-call]  # the library's
            wire.SDO_REQUEST + node,
            wire.SDO_ANSWER + node,
            ObjectDictionary(),  # type: ignore[no-untyped-call]  # the library's
        )
        self.network = _Wire(bus)
        self.RESPONSE_TIMEOUT = answer_s
        self.MAX_RETRIES = tries
        self.name = f"node {node} on {bus.name}"
        self._poll_bus, self._stopping, self._now_ns = poll_bus, stopping, monotonic_ns
        self._answers: deque[bytes] = deque()
        self._waits = False
        self._object: bytes | None = None
        self._unanswered: dict[bytes, deque[int]] = {}  # by object: time of the request
        self.surplus = 0

    def take(self, data: bytes | bytearray) -> None:
        about = bytes(data[1:4])
        unanswered = self._unanswered.get(about)
        was_asked = bool(unanswered)
        if unanswered:
            unanswered.popleft()
        if self._object not in (None, about):
            return  # the late answer to an earlier request
        if self._waits:
            self._answers.append(bytes(data))
            self._waits = False
        elif self._object is not None and not was_asked:
            self.surplus += 1

    def expect(self, request: bytes, times: int) -> None:
        """Expect answers to earlier requests of another requester."""
        for _ in range(times):
            self._note_question(request[1:4])

    def read(self, index: int, sub: int = 0) -> bytes:
        """Read the bytes of an object.

        Raises:
            NodeError: the node does not answer, or refuses.
        """
        try:
            return bytes(self.upload(index, sub))
        except SdoAbortedError as error:
            raise self._refused("read", index, sub, error) from error
        except SdoCommunicationError as error:
            raise self._silent(index, sub, error) from error

    def read_number(self, index: int, sub: int = 0) -> int:
        """Read an unsigned number.

        Raises:
            NodeError: the node does not answer, or refuses.
        """
        return int.from_bytes(self.read(index, sub), "little")

    def find_number(self, index: int, sub: int = 0) -> int | None:
        """Read an unsigned number; None if the node has no such object.

        Raises:
            NodeError: the node does not answer.
        """
        try:
            return self.read_number(index, sub)
        except NodeRefusedError:
            return None

    def write(self, index: int, sub: int, value: int, n_bytes: int) -> None:
        """Set an object to a number of ``n_bytes``.

        Raises:
            NodeError: the node does not answer, or refuses.
        """
        self.write_bytes(index, sub, value.to_bytes(n_bytes, "little"))

    def write_bytes(self, index: int, sub: int, data: bytes) -> None:
        """Set an object.

        Raises:
            NodeError: the node does not answer, or refuses.
        """
        try:
            self.download(index, sub, data)
        except SdoAbortedError as error:
            raise self._refused("write", index, sub, error) from error
        except SdoCommunicationError as error:
            raise self._silent(index, sub, error) from error

    # -- how the library sends and waits ---------------------------------------

    def send_request(self, request: bytes) -> None:
        """Send a request; nothing received before is its answer."""
        self._answers.clear()
        self._waits = request[0] != ABORTED  # an abort has no answer
        begins = request[0] & 0xE0 in BEGINNINGS
        self._object = bytes(request[1:4]) if begins else None
        if self._object is not None:
            self._note_question(self._object)
        super().send_request(request)  # type: ignore[no-untyped-call]  # the library's

    def read_response(self) -> bytes:
        until_ns = self._now_ns() + int(self.RESPONSE_TIMEOUT * 1e9)
        while not self._answers:
            left_s = (until_ns - self._now_ns()) * 1e-9
            if self._stopping():
                raise DeviceError(f"closed during a request to {self.name}", "go on")
            if left_s <= 0:
                raise SdoCommunicationError("no answer")
            self._poll_bus(min(left_s, SHORT_WAIT_S))
        response = self._answers.popleft()
        if response[0] == ABORTED:
            raise SdoAbortedError(int.from_bytes(response[4:], "little"))
        return response

    def _note_question(self, about: bytes) -> None:
        now_ns = self._now_ns()
        unanswered = self._unanswered.setdefault(about, deque())
        while unanswered and now_ns - unanswered[0] > LATEST_NS:
            unanswered.popleft()
        unanswered.append(now_ns)

    def _refused(
        self, action: str, index: int, sub: int, error: SdoAbortedError
    ) -> NodeRefusedError:
        code = int(error.code)
        why = ABORTS.get(code, "see its manual")
        return NodeRefusedError(
            f"{self.name} refused to {action} object "
            f"{index:04X}:{sub:02X}: {code:08X}, {why}",
            "check the encoder's type and its manual on this object",
            code,
        )

    def _silent(self, index: int, sub: int, error: SdoCommunicationError) -> NodeError:
        return NodeError(
            f"{self.name} does not answer (request for object "
            f"{index:04X}:{sub:02X}, {self.MAX_RETRIES} times {self.RESPONSE_TIMEOUT:g}"
            f" s: {error})",
            "check its power, its number, the bit rate and the termination of the bus",
        )
