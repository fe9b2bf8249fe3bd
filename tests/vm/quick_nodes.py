"""Encoders that cost little, as a program of their own: an emulated computer is slow.

All counts go up by one from SYNC to SYNC, each from its number times 1000. With a
number of seconds behind it, one of them answers so late now and then.
"""

import select
import sys
import time
from collections import deque

from tests.drivers.canopen.fake_nodes import FakeNode, u32
from tests.vm.can_interface import FRAME, listen

BEAT_S = 0.3
PRE_OPERATIONAL = 0x7F
LATE_NODE, LATE_OF = 13, range(20, 40)  # of 60 SYNCs


def live(numbers: tuple[int, ...], late_s: float = 0.0) -> None:
    held: deque[tuple[float, bytes]] = deque()
    port = listen(0x000, 0x080, *(0x600 + n for n in numbers))
    nodes = {n: FakeNode(n, 1000 * n) for n in numbers}
    n_syncs = 0
    answering: list[int] = []
    beat_s = time.monotonic()
    print("ready", flush=True)  # noqa: T201 - for the program that started it
    while True:
        while held and held[0][0] <= time.monotonic():
            port.send(held.popleft()[1])
        wait_s = max(0.0, held[0][0] - time.monotonic()) if held else BEAT_S
        if select.select([port], [], [], wait_s)[0]:
            can_id, length, data = FRAME.unpack(port.recv(FRAME.size))
            if can_id == 0x080:
                for n in answering:
                    frame = FRAME.pack(0x180 + n, 4, u32(1000 * n + n_syncs))
                    if late_s and n == LATE_NODE:  # in order, as an encoder sends
                        is_late = n_syncs % 60 in LATE_OF
                        due_s = time.monotonic() + late_s * is_late
                        held.append((max(due_s, held[-1][0] if held else 0.0), frame))
                    else:
                        port.send(frame)
                n_syncs += 1
            elif can_id == 0:
                answering = obey(nodes, data)
            elif (node := nodes.get(can_id - 0x600)) and data[0] != 0x80:
                answer = node.answer(data[:length])
                port.send(FRAME.pack(can_id - 0x80, 8, answer))
        if time.monotonic() - beat_s > BEAT_S:
            beat_s = time.monotonic()
            for n in numbers:
                port.send(FRAME.pack(0x700 + n, 1, bytes((nodes[n].state,))))


def obey(nodes: dict[int, FakeNode], data: bytes) -> list[int]:
    states = {1: 5, 2: 4, 0x80: PRE_OPERATIONAL}
    for number, node in nodes.items():
        if data[1] in (0, number):
            node.state = states.get(data[0], node.state)
    return [number for number, node in nodes.items() if node.sends_position]


if __name__ == "__main__":
    live((11, 12, 13, 14, 15, 16, 17), *map(float, sys.argv[1:]))
