"""The real program started and refused, as a process."""

import asyncio
import signal
import sys
from pathlib import Path

import pytest

from tests.daemon.values import ARM, arm_file
from tests.drivers.latch_board import frame_bodies as bodies
from tests.drivers.latch_board.fake_board import HELLO, FakeBoard
from tests.mosquitto import free_port
from tests.running import run_program

TIME_LIMIT_S = 60
CHANNELS = ((32, 0), (23, 1 << 23), (20, 1 << 20))

CONFIGURATION = """\
[arm]
file = "arm.toml"
[broker]
host = "127.0.0.1"
port = {port}
[[device]]
id = "base"
driver = "latch-board"
port = "{device}"
[[capture.inputs]]
source = "base/0"
trigger = "button"
"""


def write(folder: Path, text: str, arm: str | None = ARM, **values: object) -> Path:
    if arm is not None:
        arm_file(folder, arm)
    path = folder / "traverse.toml"
    path.write_text(text.format(**values))
    return path


def command(path: Path) -> list[str]:
    return [sys.executable, "-m", "traverse", "run", "--config", str(path)]


def run(path: Path) -> tuple[int, str]:
    done = run_program(*command(path), status=None)
    return done.returncode, done.stderr


def test_device_and_broker_that_are_not_there_are_told_together(tmp_path):
    port = free_port()
    device = tmp_path / "ttyNone"
    status, text = run(write(tmp_path, CONFIGURATION, port=port, device=device))
    assert status == 3
    assert "traverse cannot start:" in text
    assert "device base" in text
    assert "there is no such port" in text
    assert f"broker 127.0.0.1:{port}: nothing listens there" in text
    assert "Traceback" not in text


def test_all_mistakes_of_the_configuration_are_reported(tmp_path):
    text = '[arm]\nfile = "arm.toml"\ncolour = 3\n[[device]]\nid = "a b"\n'
    status, told = run(write(tmp_path, text))
    assert status == 2
    for where in ("arm.colour", "device[0].id", "device[0].driver"):
        assert where in told
    assert "Traceback" not in told


def test_a_missing_broker_table_and_a_wrong_arm_file_are_told_together(tmp_path):
    start = CONFIGURATION.index("[broker]")
    end = CONFIGURATION.index("[[device]]")
    text = CONFIGURATION[:start] + CONFIGURATION[end:]
    arm = ARM.replace("base/2", "shoulder/2")
    status, told = run(write(tmp_path, text, arm, device="/dev/null"))
    assert status == 2
    assert "--embedded-broker" in told
    assert "shoulder" in told


def test_a_missing_arm_file_is_reported(tmp_path):
    path = write(tmp_path, CONFIGURATION, arm=None, port=1, device="/dev/null")
    status, told = run(path)
    assert status == 2
    assert "arm.toml" in told
    assert "Traceback" not in told


def test_a_missing_configuration_is_reported(tmp_path):
    status, told = run(tmp_path / "nowhere.toml")
    assert status == 2
    assert "nowhere.toml" in told
    assert "Traceback" not in told


def test_a_clock_that_reads_no_joint_is_refused(tmp_path):
    text = CONFIGURATION + '[assembly]\nclock = "handle"\n'
    text += '[[device]]\nid = "handle"\ndriver = "latch-board"\nport = "/dev/null"\n'
    status, told = run(write(tmp_path, text, port=1, device="/dev/null"))
    assert status == 2
    assert "assembly.clock: 'handle' reads no joint; one of these does: base" in told


@pytest.mark.needs("mosquitto")
def test_a_board_that_does_not_fit_the_arm_file_is_refused(tmp_path, mosquitto):
    with FakeBoard(tmp_path / "ttyBoard") as board:  # two channels, the arm has three
        path = write(tmp_path, CONFIGURATION, port=mosquitto.port, device=board.link)
        status, told = run(path)
    assert status == 2
    assert "joint 1 of the arm is on channel 2, but base has 2 channels" in told


@pytest.mark.needs("mosquitto")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
async def test_it_runs_until_it_is_told_to_stop(tmp_path, mosquitto, number):
    with FakeBoard(tmp_path / "ttyBoard") as board:
        board.counts = (1000, 2000, 3000)
        board.answers[HELLO] = lambda body: [bodies.hello(body[1], channels=CHANNELS)]
        path = write(tmp_path, CONFIGURATION, port=mosquitto.port, device=board.link)
        process = await asyncio.create_subprocess_exec(
            *command(path), stderr=asyncio.subprocess.PIPE
        )
        try:
            async with asyncio.timeout(TIME_LIMIT_S):
                line = b""
                while b"arm bench-7" not in line:
                    line = await process.stderr.readline()
                    assert line, "the daemon ended by itself"
            process.send_signal(number)
            _, rest = await asyncio.wait_for(process.communicate(), TIME_LIMIT_S)
        finally:
            if process.returncode is None:
                process.kill()
                await process.communicate()
    assert process.returncode == 0
    assert b"Traceback" not in rest
