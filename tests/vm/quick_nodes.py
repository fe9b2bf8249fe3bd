"""Encoders that cost little, as a program of their own: an emulated computer is slow.

All counts go up by one from SYNC to SYNC, each from its number times 1000.
"""

import select
import time

from tests.drivers.fake_canopen import FakeNode, u32
from tests.vm.can_interface import FRAME, listen

BEAT_S = 0.3
PRE_OPERATIONAL = 0x7F


def live(numbers: tuple[int, ...]) -> None:
    """Answer for ever."""
    port = listen(0x000, 0x080, *(0x600 + n for n in numbers))
    nodes = {n: FakeNode(n, 1000 * n) for n in numbers}
    n_syncs = 0
    answering: list[int] = []
    beat_s = time.monotonic()
    print("ready", flush=True)  # noqa: T201 - for the program that started it
    while True:
        if select.select([port], [], [], BEAT_S)[0]:
            can_id, length, data = FRAME.unpack(port.recv(FRAME.size))
            if can_id == 0x080:
                for n in answering:
                    count = u32(1000 * n + n_syncs)
                    port.send(FRAME.pack(0x180 + n, 4, count))
                n_syncs += 1
            elif can_id == 0:
                states = {1: 5, 2: 4, 0x80: PRE_OPERATIONAL}
                for n in numbers if not data[1] else [data[1]]:
                    if n in nodes:
                        nodes[n].state = states.get(data[0], nodes[n].state)
                answering = [n for n in numbers if nodes[n].sends_position]
            elif (node := nodes.get(can_id - 0x600)) and data[0] != 0x80:
                answer = node.answer(data[:length])
                port.send(FRAME.pack(can_id - 0x80, 8, answer))
        if time.monotonic() - beat_s > BEAT_S:
            beat_s = time.monotonic()
            for n in numbers:
                port.send(FRAME.pack(0x700 + n, 1, bytes((nodes[n].state,))))


if __name__ == "__main__":
    live((11, 12, 13, 14, 15, 16, 17))
