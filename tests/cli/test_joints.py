"""`traverse joints` on a board, its encoders turned in another order than named."""

import json
import subprocess
import sys

import pytest

from tests.firmware.host_rig import HostBoard
from traverse.kinematics.arm_file.arm import read_arm

pytestmark = pytest.mark.needs("compiler")

BITS = 23
ARM = """schema = "traverse/arm/1"
name = "parts"  # the designer's
origin_mm = [0, 0, 0]

[[joints]]
name = "J1"
axis = [0, 0, 1]
link_mm = [0, 0, 300]
zero_rad = 0.0

[[joints]]
name = "J2"
axis = [0, 1, 0]
link_mm = [500, 0, 0]
zero_rad = 0.25
[joints.encoder]
source = "board/0"
counts_per_turn = 8388608
sign = 1

[[joints]]
name = "J3"
axis = [0, 1, 0]
link_mm = [400, 0, 0]
zero_rad = 0.0

[probe]
radius_mm = 3.0
vector_mm = [50, 0, 0]
"""
DAEMON = """[arm]
file = "arm.toml"
[[device]]
id = "board"
driver = "latch-board"
port = "{port}"
"""


class Conversation:
    def __init__(self, folder, *options):
        self._process = subprocess.Popen(
            [sys.executable, "-m", "traverse", "joints", "daemon.toml", *options],
            cwd=folder,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def event(self, *kinds):
        for line in self._process.stdout:
            event = json.loads(line)
            if event["event"] in kinds:
                return event
        raise AssertionError(f"it ended before {kinds}")

    def enter(self, text=""):
        self._process.stdin.write(f"{text}\n")
        self._process.stdin.flush()

    def end(self):
        rest, _ = self._process.communicate(timeout=20.0)
        return self._process.returncode, [json.loads(li) for li in rest.splitlines()]


@pytest.fixture
def board(tmp_path):
    (tmp_path / "arm.toml").write_text(ARM)
    with HostBoard(tmp_path / "port", "--channels", "4", "--bits", str(BITS)) as board:
        (tmp_path / "daemon.toml").write_text(DAEMON.format(port=board.link))
        yield board


def turn(conversation, board, counts):
    conversation.event("turn")
    board.do(*(f"count {channel} {count}" for channel, count in counts.items()))
    conversation.enter()
    return conversation.event("found", "again")


def test_each_joint_is_found_by_turning_it_and_written(board, tmp_path):
    quarter = 2 ** (BITS - 2)
    board.do("status 3 1", "status 1 2")
    conversation = Conversation(tmp_path, "--json")
    channels = [conversation.event("channel") for _ in range(4)]
    assert [c["n_invalid"] == c["n_samples"] for c in channels] == [False] * 3 + [True]
    assert [c["n_weak"] > 0 for c in channels] == [False, True, False, False]

    # Backwards over its wrap, by a little less than requested.
    finding = turn(conversation, board, {2: 2**BITS - quarter + 50_000})
    assert (finding["source"], finding["sign"]) == ("board/2", -1)
    refusal = turn(conversation, board, {0: quarter, 1: quarter})
    assert "more than one joint was turned: board/0, board/1" in refusal["reason"]
    finding = turn(conversation, board, {1: quarter + quarter})
    assert (finding["source"], finding["sign"], finding["counts_per_turn"]) == (
        "board/1",
        1,
        2**BITS,
    )
    repeated = turn(conversation, board, {2: 0})
    assert "board/2 is J1's encoder already" in repeated["reason"]
    finding = turn(conversation, board, {0: 0})
    assert (finding["source"], finding["sign"]) == ("board/0", -1)
    status, events = conversation.end()
    assert status == 0
    assert events[-1]["event"] == "end"

    joints = read_arm(tmp_path / "arm.toml").joints
    assert [(j.encoder.source, j.encoder.sign) for j in joints] == [
        ("board/2", -1),
        ("board/1", 1),
        ("board/0", -1),
    ]
    assert {j.encoder.counts_per_turn for j in joints} == {2**BITS}
    text = (tmp_path / "arm.toml").read_text()
    assert "# the designer's" in text
    assert "zero_rad = 0.25" in text


def test_joints_that_are_left_out_are_named_and_the_file_stays(board, tmp_path):
    conversation = Conversation(tmp_path, "--json")
    conversation.event("turn")
    conversation.enter("s")
    conversation.event("turn")
    conversation.enter("q")
    status, events = conversation.end()
    assert status == 1
    assert events[-1] == {"event": "not_found", "joints": ["J1", "J2", "J3"]}
    assert (tmp_path / "arm.toml").read_text() == ARM


def test_a_device_that_is_not_there_ends_it_with_the_port(tmp_path):
    (tmp_path / "arm.toml").write_text(ARM)
    (tmp_path / "daemon.toml").write_text(DAEMON.format(port=tmp_path / "nowhere"))
    ran = subprocess.run(
        [sys.executable, "-m", "traverse", "joints", "daemon.toml"],
        cwd=tmp_path,
        input="",
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert ran.returncode == 3
    assert "nowhere" in ran.stderr
