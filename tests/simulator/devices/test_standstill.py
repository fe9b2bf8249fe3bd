"""A simulator that was suspended, on a busy computer, catches up piece by piece."""

import os
import select
import threading

from tests.simulator.one_hinge import mounted
from tests.simulator.test_process import HELLO, START_1_KHZ
from traverse.simulator.devices.latch_board.device import (
    LatchBoardTable,
    SimulatedLatchBoard,
)

STOOD_S = 10.0


def test_a_host_that_reads_loses_nothing_to_it(tmp_path):
    table = LatchBoardTable(id="base", kind="latch-board", port="base")
    board = SimulatedLatchBoard(table, mounted(tmp_path, table))
    host = os.open(tmp_path / "base", os.O_RDWR | os.O_NOCTTY)
    board.live(0.001)  # it has detected its host
    os.write(host, HELLO + START_1_KHZ)
    board.live(0.002)
    over = threading.Event()

    def read():
        while not over.is_set():
            if select.select([host], [], [], 0.01)[0]:
                os.read(host, 65_536)

    reading = threading.Thread(target=read)
    reading.start()
    board.live(STOOD_S)
    over.set()
    reading.join()
    totals = board.totals()
    os.close(host)
    board.close()
    assert abs(totals["samples"] - 1000 * STOOD_S) < 10
    assert totals["tx_dropped"] == 0
