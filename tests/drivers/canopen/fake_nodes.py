"""CANopen encoders at the other end of a virtual bus, for tests to command.

Written from the bytes of CiA 301 and 406, with expedited transfers only; it uses
nothing of the code under test. By themselves they answer questions, obey NMT,
send heartbeats, answer SYNCs if `answers_sync`.
"""

import heapq
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import can

from traverse.testing.pty_peer import Peer

TURN_S = 0.001
ABORT_NO_OBJECT, ABORT_READ_ONLY = 0x0602_0000, 0x0601_0002

PRE_OPERATIONAL, OPERATIONAL, STOPPED = 0x7F, 5, 4


def u8(value: int) -> bytes:
    return value.to_bytes(1, "little")


def u16(value: int) -> bytes:
    return value.to_bytes(2, "little")


def u32(value: int) -> bytes:
    return value.to_bytes(4, "little")


def realtime_ahead_ns() -> int:
    """Offset of realtime from monotonic [ns], read without interruption."""
    while True:
        before_ns, now_ns, after_ns = (
            time.monotonic_ns(),
            time.time_ns(),
            time.monotonic_ns(),
        )
        if after_ns - before_ns < 20_000:
            return now_ns - before_ns


@dataclass(eq=False)
class FakeNode:
    """One encoder: its objects, by index and sub-index, and its state.

    Attributes:
        refuses: objects that cannot be written.
        ignores: objects whose writes are accepted and change nothing.
        mute: it sends nothing.
        doubles: it sends everything twice.
        late_s: how long after a SYNC its answer is sent.
        loses: SYNCs that it does not answer, counted from now.
    """

    number: int
    count: int = 1000
    per_turn: int = 1 << 16
    turns: int = 1 << 12
    state: int = PRE_OPERATIONAL
    refuses: set[tuple[int, int]] = field(default_factory=set)
    ignores: set[tuple[int, int]] = field(default_factory=set)
    mute: bool = False
    doubles: bool = False
    late_s: float = 0.0
    loses: int = 0
    objects: dict[tuple[int, int], bytes] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.power_up()

    def power_up(self) -> None:
        self.state = PRE_OPERATIONAL
        self.objects = {
            (0x1000, 0): u32(0x0002_0196),
            (0x1017, 0): u16(0),
            (0x1018, 1): u32(0x5F),
            (0x1018, 2): u32(0x406),
            (0x1018, 3): u32(1),
            (0x1018, 4): u32(self.number),
            (0x1800, 1): u32(0x4000_0180 + self.number),
            (0x1800, 2): u8(254),
            (0x1801, 1): u32(0x280 + self.number),
            (0x1801, 2): u8(1),
            (0x1A00, 0): u8(0),
            (0x1A00, 1): u32(0),
            (0x6000, 0): u16(0),
            (0x6501, 0): u32(self.per_turn),
            (0x6502, 0): u16(self.turns & 0xFFFF),
            (0x6503, 0): u16(0),
            (0x6505, 0): u16(0),
            (0x6507, 0): u32(0x0404_0302),
        }

    @property
    def sends_position(self) -> bool:
        cob_id = int.from_bytes(self.objects[(0x1800, 1)], "little")
        return (
            self.state == OPERATIONAL
            and not self.mute
            and cob_id == 0x180 + self.number
            and self.objects[(0x1800, 2)] == b"\x01"
            and self.objects[(0x1A00, 0)] == b"\x01"
            and self.objects[(0x1A00, 1)] == bytes.fromhex("20 00 04 60")
        )

    def answer(self, request: bytes) -> bytes:
        key = (int.from_bytes(request[1:3], "little"), request[3])
        self.objects[(0x6004, 0)] = u32(self.count)
        if key not in self.objects:
            return b"\x80" + request[1:4] + u32(ABORT_NO_OBJECT)
        if request[0] == 0x40:
            data = self.objects[key]
            code = {1: 0x4F, 2: 0x4B, 3: 0x47, 4: 0x43}[len(data)]
            return bytes((code,)) + request[1:4] + data.ljust(4, b"\0")
        if key in self.refuses:
            return b"\x80" + request[1:4] + u32(ABORT_READ_ONLY)
        size = {0x2F: 1, 0x2B: 2, 0x27: 3, 0x23: 4}[request[0]]
        if key not in self.ignores:
            self.objects[key] = request[4 : 4 + size]
        return b"\x60" + request[1:4] + bytes(4)


class FakeNodes(Peer):
    """Encoders on a virtual bus; all counts go up by one from SYNC to SYNC.

    Attributes:
        answers_sync: whether they answer SYNCs.
        heard: received frames, identifier and data.
        synced_ns: when each SYNC was sent to which they count, host's monotonic clock.
        distort: changes frames to be sent: identifier and data in, frames out.
    """

    def __init__(self, channel: str, numbers: tuple[int, ...] = (5, 9)) -> None:
        super().__init__()
        self.channel = channel
        self.nodes = {n: FakeNode(n, 1000 + 7 * k) for k, n in enumerate(numbers)}
        self.answers_sync = False
        self.heard: list[tuple[int, bytes]] = []
        self.synced_ns: list[int] = []
        self.distort: Callable[[int, bytes], list[tuple[int, bytes]]] = lambda i, d: [
            (i, d)
        ]
        self._lock = threading.RLock()
        self._beats_ns: dict[int, int] = {}
        self._late: list[tuple[float, int, int, bytes]] = []
        self._due_s: dict[int, float] = {}
        self._n_late = 0
        self._realtime_ahead_ns = realtime_ahead_ns()

    def _open(self) -> None:
        self._bus = can.Bus(self.channel, "virtual", ignore_config=True)

    def _close(self) -> None:
        self._bus.shutdown()

    # -- what tests do --------------------------------------------------------

    def send(self, can_id: int, data: bytes, error: bool = False) -> None:
        with self._lock:
            if self._plugged:
                self._bus.send(
                    can.Message(
                        arbitration_id=can_id,
                        data=data,
                        is_extended_id=False,
                        is_error_frame=error,
                    )
                )

    def sync(self, n: int, lost: bool = False) -> None:
        """Send SYNCs as another master would; all nodes answer, or none."""
        with self._lock:
            if self._plugged:  # earlier settings are applied first
                self._listen()
        for _ in range(n):
            self.send(0x080, b"")
            self.latch(lost)

    def latch(self, lost: bool = False) -> None:
        with self._lock:
            for node in self.nodes.values():
                if node.sends_position and not lost:
                    self._answer_sync(node)
                node.count += 1

    def _answer_sync(self, node: FakeNode) -> None:
        position = u32(node.count)
        if node.loses:
            node.loses -= 1
            return
        now_s = time.monotonic()
        due_s = max(now_s + node.late_s, self._due_s.get(node.number, 0.0))
        if due_s <= now_s:
            self.say(node, 0x180 + node.number, position)
            return
        self._due_s[node.number] = due_s  # an encoder sends in order
        self._n_late += 1
        heapq.heappush(self._late, (due_s, self._n_late, node.number, position))

    def say(self, node: FakeNode, can_id: int, data: bytes) -> None:
        if not node.mute:
            for frame in self.distort(can_id, data) * (1 + node.doubles):
                self.send(*frame)

    def restart(self, number: int) -> None:
        with self._lock:
            node = self.nodes[number]
            node.power_up()
            self.say(node, 0x700 + number, b"\0")

    # -- their life -----------------------------------------------------------

    def _live(self) -> None:
        while self._plugged:
            with self._lock:
                self._listen()
                self._beat()
                while self._late and self._late[0][0] <= time.monotonic():
                    *_, number, position = heapq.heappop(self._late)
                    self.say(self.nodes[number], 0x180 + number, position)
            time.sleep(TURN_S)

    def _listen(self) -> None:
        while (message := self._bus.recv(0)) is not None:
            if message.arbitration_id == 0x080:
                sent_ns = int(1e9 * message.timestamp)
                self.synced_ns.append(sent_ns - self._realtime_ahead_ns)
            self._take(message.arbitration_id, bytes(message.data))

    def _take(self, can_id: int, data: bytes) -> None:
        self.heard.append((can_id, data))
        if can_id == 0x080 and self.answers_sync:
            self.latch()
        elif can_id == 0:
            for node in self.nodes.values():
                if data[1] in (0, node.number):
                    self._obey(node, data[0])
        addressed = self.nodes.get(can_id - 0x600)
        if addressed is not None and not addressed.mute and data[0] != 0x80:
            self.say(addressed, 0x580 + addressed.number, addressed.answer(data))

    def _obey(self, node: FakeNode, command: int) -> None:
        states = {1: OPERATIONAL, 2: STOPPED, 0x80: PRE_OPERATIONAL}
        node.state = states.get(command, node.state)

    def _beat(self) -> None:
        now_ns = time.monotonic_ns()
        for node in self.nodes.values():
            period_ms = int.from_bytes(node.objects[(0x1017, 0)], "little")
            if period_ms and now_ns >= self._beats_ns.get(node.number, 0):
                self._beats_ns[node.number] = now_ns + period_ms * 1_000_000
                self.say(node, 0x700 + node.number, bytes((node.state,)))
