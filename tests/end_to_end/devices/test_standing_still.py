"""No point is wrong unmarked where daemon and devices stand still again and again.

As on a computer with too much to do, or one that is suspended. What they cost is
marked, refused or lost with an event, whatever reads the encoders. A board without
encoders keeps its edges until its clock is known, which may last as long as everything
stands still again and again; when that is over they are dealt with.
"""

import asyncio
import contextlib
import os
import random
import signal

import numpy as np
import pytest

from tests.end_to_end.arm_matrices import MatrixArm
from tests.end_to_end.devices import test_amt21_arm as amt21
from tests.end_to_end.devices import test_canopen_arm as canopen
from tests.end_to_end.devices import test_text_line as text_line
from tests.end_to_end.measuring import measuring
from tests.end_to_end.programs import Program
from tests.end_to_end.workbench import REST, SPHERE, Workbench, rest
from traverse.client.cancel_tasks import cancel_tasks
from traverse.testing.waiting import until

pytestmark = [pytest.mark.needs("mosquitto"), pytest.mark.slow]

line = amt21.line  # a fixture
LONGEST_S = (0.06, 0.5, 1.8)  # little more than a reading's time limit, to seconds
TRIED_S = 12.0
# At rest until all is established, which a motion would put off.
SCENE = (rest(3.0), SPHERE.format(points=6), REST)


async def stand_still(programs: list[Program]) -> None:
    rng = random.Random(4)
    while True:
        process = rng.choice(programs).process
        await asyncio.sleep(rng.uniform(0.05, 0.4))
        process.send_signal(signal.SIGSTOP)
        try:
            await asyncio.sleep(rng.uniform(0.02, rng.choice(LONGEST_S)))
        finally:
            process.send_signal(signal.SIGCONT)


def n_kept(bench: Workbench) -> int:
    """Presses so far that a board keeps until the daemon has dealt with them."""
    return sum(press["device"] == "handle" for press in bench.presses())


async def all_are_right_or_marked(bench: Workbench) -> None:
    # On a busy machine numbers may be in doubt before the first standstill.
    async with measuring(bench, state=None) as (listener, simulator, daemon):
        stopping = asyncio.create_task(stand_still([simulator, daemon]))
        with contextlib.suppress(AssertionError):  # some may be refused
            await listener.n_points(6, TRIED_S)
        await cancel_tasks([stopping])
        await until(
            lambda: (
                (listener.points or listener.events_of("capture.refused"))
                and len(listener.events_of("button.pressed")) >= n_kept(bench)
            ),
            "a point or a refusal of each press after the last standstill",
        )
    rounding_mm = MatrixArm(bench.arm_file).resolution_mm()
    truth_mm = np.array([edge["centre_mm"] for edge in bench.presses()])
    for point in listener.points:
        off_mm = np.abs(truth_mm - np.array(point.xyz_mm)).max(axis=1).min()
        assert off_mm < 2 * rounding_mm or not point.quality.ok, point


async def test_a_latching_board(bench: Workbench) -> None:
    bench.write_simulator(*SCENE)
    bench.write_daemon()
    await all_are_right_or_marked(bench)


async def test_canopen_and_the_button_on_a_board(bench: Workbench) -> None:
    bench.write_simulator(*SCENE, board=canopen.ENCODERS)
    canopen.write_daemon(bench)
    await all_are_right_or_marked(bench)


async def test_amt21_and_the_button_on_a_board(line: Workbench) -> None:
    line.write_simulator(*SCENE, board=amt21.ENCODERS)
    pedal = os.open(line.folder / "pedal", os.O_RDWR)
    await all_are_right_or_marked(line)
    os.close(pedal)


async def test_a_printing_board(bench: Workbench) -> None:
    bench.write_simulator(*SCENE, board=text_line.BOARD)
    text_line.write_daemon(bench)
    await all_are_right_or_marked(bench)
