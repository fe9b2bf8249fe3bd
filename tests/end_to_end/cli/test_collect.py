import asyncio
import contextlib
import json
import os
import pty
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from tests.campaign_texts import ONE_CONE
from tests.end_to_end.agreement import is_marked_for_time
from tests.end_to_end.listener import Listener
from tests.end_to_end.measuring import measuring
from tests.end_to_end.programs import PATIENCE_S, Program
from tests.end_to_end.workbench import CONE, REST, SPHERE, Workbench, rest
from tests.mosquitto import HOST, free_port
from traverse.kinematics.arm_file.arm import read_arm
from traverse.lab.campaign.campaign import read_campaign
from traverse.protocol.messages import PointArgs
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto")

SEEN_NS = 200_000_000  # motion is known for a quarter of a second
# The simulated operator touches as often as the script says; a busy machine
# may leave the clock in doubt at some touches, for which an operator would touch again.
ALLOW = ("--allow", "surface_unknown,empirical,time_uncertain")
CAMPAIGN = ONE_CONE + '[[artefacts]]\nid = "ball"\nkind = "sphere"\n'


def options(bench: Workbench, *extra: str) -> list[str]:
    where = ["--broker", f"{bench.host}:{bench.port}"]
    return ["collect", "campaign.toml", "--arm", "arm.toml", *where, *extra]


@pytest.fixture
def campaign(bench: Workbench) -> Workbench:
    (bench.folder / "campaign.toml").write_text(CAMPAIGN)
    return bench


async def touch(listener: Listener, n: int) -> None:
    """Take so many points that count.

    A busy machine may leave a clock in doubt: as the program says, such a point is
    left out, and the operator touches again.
    """
    while n:
        n_points = len(listener.points)
        assert (await listener.command(PointArgs())).ok
        await listener.n_points(n_points + 1)
        flags = set(listener.points[-1].quality.flags)
        assert flags <= {"time_uncertain"}, flags
        n -= not flags


async def test_a_campaign_is_collected_as_it_is_touched(campaign: Workbench) -> None:
    bench = campaign
    lead_in = rest(3.0)  # until the clock of the board is tied
    bench.write_simulator(lead_in, CONE.format(postures=5), SPHERE.format(points=5))
    bench.write_daemon(capture="live_rate_hz = 100.0")
    arguments = options(bench, "--each", "5", "--json", *ALLOW)
    collecting = Program(bench.folder, "collect", *arguments)
    with collecting:
        await collecting.says("Touch seat (cone): 5 more")
        await collecting.says("following")
        async with measuring(bench) as (listener, _, _):
            await listener.n_points(10)
            assert await collecting.ended() == 0
        assert "seat: 5 of 5; 0.0" in collecting.log
        assert "ball: 5 of 5; radius 53.8" in collecting.log
        report = json.loads(collecting.output)
        assert (report["poses"], report["complete"]) == (10, True)
        assert {feature["touches"] for feature in report["features"]} == {5}
        arm = read_arm(bench.arm_file)
        names = [joint.name for joint in arm.joints]
        collected = read_campaign(bench.folder, names)
    presses = bench.presses()
    assert collected.poses.artefacts.tolist() == [0] * 5 + [1] * 5
    took = [point.angles_rad for point in listener.points]
    np.testing.assert_array_equal(collected.poses.angles_rad, took)
    assert len(presses) == 10
    certain = [not is_marked_for_time(point) for point in listener.points]
    assert sum(certain) >= 7
    pressed_s = np.array([press["script_s"] for press in presses])
    late_s = (collected.poses.time_s - pressed_s)[certain]
    assert np.abs(np.diff(late_s)).max() < 2e-3
    # The arm was led to each touch: every pose has the sense of some joint's motion,
    # but where a busy machine published no live pose in the quarter second before it,
    # or does not know when it was.
    senses = collected.poses.approaches
    assert senses is not None
    was_seen = [
        is_certain
        and any(0 <= point.time_ns - at_ns < SEEN_NS for at_ns in listener.live_ns)
        for point, is_certain in zip(listener.points, certain, strict=True)
    ]
    assert sum(was_seen) >= 7
    assert (np.abs(np.nan_to_num(senses)).sum(axis=1) > 0)[was_seen].all()


@pytest.mark.slow
async def test_an_ended_collection_continues_where_it_was(campaign: Workbench) -> None:
    bench = campaign
    bench.write_simulator(REST)
    bench.write_daemon()
    async with measuring(bench) as (listener, _, _):
        with Program(bench.folder, "first", *options(bench, "--each", "2")) as first:
            await first.says("following")
            await touch(listener, 1)
            await first.says("on seat: 1 of 2")
            first.process.kill()
        with Program(bench.folder, "again", *options(bench, "--each", "2")) as repeated:
            await repeated.says("Touch seat (cone): 1 more")
            await repeated.says("following")
            await touch(listener, 3)
            assert await repeated.ended() == 0
    lines = (bench.folder / "poses.csv").read_text().splitlines()
    assert len(lines) == 1 + 4


@dataclass
class Terminal:
    descriptor: int
    process: subprocess.Popen[bytes]
    shown: bytearray

    async def shows(self, text: str) -> None:
        await until(lambda: text.encode() in self.shown, f"{text!r} on the terminal")

    def type(self, keys: bytes) -> None:
        os.write(self.descriptor, keys)

    async def quit(self) -> int:
        self.type(b"q")
        return await asyncio.to_thread(self.process.wait, PATIENCE_S)


@contextlib.contextmanager
def terminal(bench: Workbench, *words: str) -> Iterator[Terminal]:
    ours, theirs = pty.openpty()
    shown = bytearray()
    asyncio.get_running_loop().add_reader(
        ours, lambda: shown.extend(os.read(ours, 65536))
    )
    process = subprocess.Popen(
        [sys.executable, "-m", "traverse", *words],
        cwd=bench.folder,
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "160", "LINES": "40"},
    )
    try:
        yield Terminal(ours, process, shown)
    finally:
        process.kill()
        process.wait()
        asyncio.get_running_loop().remove_reader(ours)
        os.close(ours)
        os.close(theirs)


async def test_keys_at_a_terminal_undo_and_quit(campaign: Workbench) -> None:
    bench = campaign
    bench.write_simulator(REST)
    bench.write_daemon()
    async with measuring(bench) as (listener, _, _):
        with terminal(bench, *options(bench, "--each", "3")) as screen:
            await screen.shows("following")
            await listener.command(PointArgs())
            await screen.shows("on seat: 1 of 3")
            screen.type(b"u")
            await screen.shows("is left out again")
            screen.type(b"nx")
            await screen.shows("Touch ball (sphere): 3 more")
            await screen.shows("is none of n, p, u, q")
            assert await screen.quit() == 1
    assert (bench.folder / "poses.csv").read_text().count("\n") == 1


ANOTHER = CONE.replace("600.0", "653.0")  # 53 mm beside


@pytest.mark.slow
@pytest.mark.parametrize(
    ("key", "message", "left"),
    [
        (b"y", "on seat: 3 of 4", 3),  # the right one
        (b"b", "on seat: 1 of 4", 1),  # the others were not
    ],
)
async def test_a_touch_of_another_seat_is_questioned(
    campaign: Workbench, key: bytes, message: str, left: int
) -> None:
    bench = campaign
    bench.write_simulator(
        rest(3.0), *(CONE.format(postures=2), ANOTHER.format(postures=1), REST)
    )
    bench.write_daemon()
    with terminal(bench, *options(bench, "--each", "4", *ALLOW)) as screen:
        await screen.shows("following")
        async with measuring(bench):
            await screen.shows("is 53.0 mm off the others on seat and does not count")
            assert b"3 of 4" not in screen.shown
            screen.type(key)
            await screen.shows(message)
            assert await screen.quit() == 1
    lines = (bench.folder / "poses.csv").read_text().splitlines()
    assert len(lines) == 1 + left


async def test_a_broker_that_is_not_there_is_told(campaign: Workbench) -> None:
    campaign.host, campaign.port = HOST, free_port()
    with Program(campaign.folder, "collect", *options(campaign)) as collecting:
        assert await collecting.ended() == 3
        assert f"broker {HOST}:{campaign.port}" in collecting.log
        assert "Traceback" not in collecting.log


@pytest.mark.parametrize(
    ("extra", "files", "message"),
    [
        (["--allow", "shaky"], {}, "no quality flag shaky"),
        ([], {"poses.csv": "time_s\n"}, "was not written by `traverse collect`"),
        ([], {"collected.jsonl": "{}\n"}, "line 1"),
        (
            [],
            {"campaign.toml": CAMPAIGN.replace("poses.csv", "scan.mcap")},
            'poses = "poses.csv"',
        ),
    ],
)
async def test_what_would_spoil_files_is_refused(
    campaign: Workbench, extra: list[str], files: dict[str, str], message: str
) -> None:
    for name, text in files.items():
        (campaign.folder / name).write_text(text)
    arguments = options(campaign, *extra)
    with Program(campaign.folder, "collect", *arguments) as collecting:
        assert await collecting.ended() == 2
        assert message in collecting.log
        assert "Traceback" not in collecting.log
    for name, text in files.items():
        assert (campaign.folder / name).read_text() == text
