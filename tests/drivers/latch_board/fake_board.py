"""A latch board at the other end of a pty, for tests to command.

It implements the board's side of docs/serial-protocol.md without the code under
test. What it does by itself: answer requests, repeat edges, send heartbeats.
"""

import contextlib
import os
import select
import struct
import threading
import time
from collections.abc import Callable
from pathlib import Path

from tests.drivers.latch_board import frame_bodies as bodies
from tests.protocol.latch_board_frames import framed
from traverse.testing.pty_peer import PtyPeer

HELLO, CONFIGURE, START, STOP, LATCH, EDGE_ACK = 1, 2, 3, 4, 5, 6
TURN_S = 0.02
LIMIT_S = 8.0

Answer = Callable[[bytes], list[bytes]]


def unstuffed(segment: bytes) -> bytes:
    """COBS undone by its definition, for frames under 254 bytes."""
    out, offset = bytearray(), 0
    while offset < len(segment):
        distance = segment[offset]
        out += segment[offset + 1 : offset + distance] + b"\0"
        offset += distance
    return bytes(out[:-1])


class FakeBoard(PtyPeer):
    """Behind a symbolic link that keeps its name when the board is plugged again.

    Attributes:
        answers: by a request's type; replace to misbehave.
        requests: received bodies, without their check sum.
        edges: edges that are not yet acknowledged, by number.
    """

    def __init__(self, link: Path, counts: tuple[int, ...] = (1000, 2000)) -> None:
        super().__init__(link)
        self.counts = counts
        self.requests: list[bytes] = []
        self.edges: dict[int, bytes] = {}
        self.answers: dict[int, Answer] = {
            HELLO: self.answer_hello,
            CONFIGURE: lambda body: [bodies.reply(CONFIGURE, body[1])],
            START: self.answer_start,
            STOP: self._answer_stop,
            LATCH: self.answer_latch,
            EDGE_ACK: self._take_acknowledgement,
        }
        self.boot_id = 1
        self.stream_request = 0
        self.next_sample = 0
        self.next_edge = 0
        self.repeats_edges = True
        self.mute = False
        self._boot_ns = time.monotonic_ns()
        self._last_ticks = 0
        self._lock = threading.RLock()
        self._pending = b""

    # -- the cable ------------------------------------------------------------

    def plug(self) -> None:
        self._pending = b""
        super().plug()

    def restart(self, *, has_chance: bool = True) -> None:
        """Lose power for a moment, the cable stays.

        Without a source of chance the boot_id is the same again.
        """
        with self._lock:
            self.boot_id += has_chance
            self.stream_request = self.next_sample = self.next_edge = 0
            self.edges.clear()
            self._boot_ns, self._last_ticks = time.monotonic_ns(), 0

    def jump(self, seconds: float) -> None:
        """The counter is ahead by so much from now on, and power was not lost."""
        with self._lock:
            self._boot_ns -= int(seconds * 1e9)
            self._last_ticks = self.ticks()

    # -- what tests do --------------------------------------------------------

    def ticks(self) -> int:
        return (time.monotonic_ns() - self._boot_ns) // 1000

    def send(self, *contents: bytes) -> None:
        self.send_bytes(b"".join(framed(body) for body in contents))

    def send_bytes(self, data: bytes) -> None:
        with self._lock:
            while data and self._plugged:
                try:
                    data = data[os.write(self._master, data) :]
                except BlockingIOError:
                    select.select([], [self._master], [], TURN_S)
                except OSError:  # the host has closed its side
                    return

    def emit(self, n: int) -> list[bytes]:
        with self._lock:
            bodies_sent = self.samples(n)
            self.send(*bodies_sent)
        return bodies_sent

    def samples(self, n: int) -> list[bytes]:
        with self._lock:
            first, self.next_sample = self.next_sample, self.next_sample + n
            last, request = self._last_ticks, self.stream_request
            self._last_ticks = now = self.ticks()
            return [
                bodies.sample(
                    request,
                    first + k,
                    last + (now - last) * (k + 1) // n,
                    [c + first + k for c in self.counts],
                )
                for k in range(n)
            ]

    def press(self, number: int = 0, level: int = 1) -> int:
        """An edge: kept and repeated until it is acknowledged; return its number."""
        with self._lock:
            seq, self.next_edge = self.next_edge, self.next_edge + 1
            counts = [c + seq for c in self.counts]
            self.edges[seq] = bodies.edge(number, level, seq, self.ticks(), counts)
        return seq

    def heard(self, request_type: int) -> list[bytes]:
        return [body for body in list(self.requests) if body[0] == request_type]

    # -- answers --------------------------------------------------------------

    def answer_hello(self, body: bytes) -> list[bytes]:
        self.stream_request = 0
        if body[3] & 1:
            self.edges.clear()
        return [bodies.hello(body[1], boot_id=self.boot_id)]

    def answer_start(self, body: bytes) -> list[bytes]:
        (rate,) = struct.unpack_from("<I", body, 2)
        self.stream_request, self.next_sample = body[1], 0
        self._last_ticks = self.ticks()
        return [bodies.reply(START, body[1], 0, rate)]

    def answer_latch(self, body: bytes) -> list[bytes]:
        return [bodies.sample(body[1], 0, self.ticks(), self.counts, cause=1)]

    def _answer_stop(self, body: bytes) -> list[bytes]:
        self.stream_request = 0
        return [bodies.reply(STOP, body[1])]

    def _take_acknowledgement(self, body: bytes) -> list[bytes]:
        (seq,) = struct.unpack_from("<I", body, 1)
        for known in [number for number in self.edges if number <= seq]:
            del self.edges[known]
        return []

    # -- its life -------------------------------------------------------------

    def _live(self) -> None:
        beat_ns = 0
        while self._plugged:
            select.select([self._master], [], [], TURN_S)
            with contextlib.suppress(OSError):
                self._take(os.read(self._master, 4096))
            now_ns = time.monotonic_ns()
            if self.mute or now_ns < beat_ns:
                continue
            beat_ns = now_ns + int(TURN_S * 1e9)
            with self._lock:
                repeated = list(self.edges.values()) if self.repeats_edges else []
                beat = bodies.heartbeat(
                    int(self.stream_request != 0),
                    self.ticks(),
                    self.next_sample,
                    self.next_edge,
                    back=self.next_edge - min(self.edges, default=self.next_edge),
                )
                self.send(*repeated, beat)

    def _take(self, data: bytes) -> None:
        *segments, self._pending = (self._pending + data).split(b"\0")
        for segment in filter(None, segments):
            body = unstuffed(segment)[:-2]
            with self._lock:
                self.requests.append(body)
                self.send(*self.answers[body[0]](body))
