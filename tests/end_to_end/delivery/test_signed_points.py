import json
import re
import signal

import pytest

from tests.end_to_end.measuring import measuring
from tests.end_to_end.workbench import REST, Workbench
from tests.running import invoke
from traverse.client import Arm
from traverse.protocol.messages import Point
from traverse.protocol.signed_points import checked_points, read_public_key

pytestmark = pytest.mark.needs("mosquitto")


def run(*words: object, status: int = 0) -> str:
    ran = invoke(*words, status=status)
    return ran.output


def write_signing(bench: Workbench) -> None:
    run("points", "key", "--out", bench.folder / "arm.key")
    bench.write_simulator(REST)
    bench.write_daemon()
    file = bench.folder / "daemon.toml"
    file.write_text(file.read_text() + '\n[signing]\nkey = "arm.key"\n')


@pytest.mark.slow
async def test_points_are_signed_and_checked_wherever_they_are(
    bench: Workbench,
) -> None:
    write_signing(bench)
    public = bench.folder / "arm.key.pub"
    broker = f"{bench.host}:{bench.port}"
    received: list[Point] = []
    async with measuring(bench) as (listener, _, daemon):
        async with Arm(bench.arm, broker) as arm:
            assert (await arm.status()).public_key == public.read_text().strip()
            received += [await arm.capture() for _ in range(4)]
            received.append(await arm.undo())
            await arm.new_session()
            received += [await arm.capture() for _ in range(2)]
        await daemon.stop(signal.SIGKILL)
        with bench.daemon(name="another") as another:
            async with Arm(bench.arm, broker) as arm:
                received += [await arm.capture() for _ in range(3)]
            await listener.n_points(len(received))
            assert await another.stop() == 0
    checked = checked_points(received, read_public_key(public.read_text()))
    assert checked.problems == []
    assert sorted(checked.last.values()) == [1, 2, 4]
    config = bench.folder / "daemon.toml"
    document = json.loads(
        run("points", "verify", "--config", config, "--key", public, "--json")
    )
    assert document == {"points": 10, "problems": [], "last": checked.last}
    file = bench.folder / "points.jsonl"
    run("points", "export", "--config", config, "--format", "jsonl", "--out", file)
    assert "10 points: signed" in run("points", "verify", file, "--key", public)
    run("trace", file, "--in", bench.folder, "--key", public)
    lines = file.read_text().splitlines(keepends=True)
    file.write_text("".join([*lines[:2], *lines[3:]]))
    result = run("points", "verify", file, "--key", public, status=1)
    assert "2 before it is missing" in result
    result = run("trace", file, "--in", bench.folder, "--key", public, status=1)
    assert "2 before it is missing" in result
    run("points", "key", "--out", bench.folder / "strangers.key")
    stranger = bench.folder / "strangers.key.pub"
    result = run("points", "verify", file, "--key", stranger, status=1)
    assert "was altered, or signed by another key" in result


async def test_a_daemon_with_a_key_that_cannot_be_used_does_not_start(
    bench: Workbench,
) -> None:
    write_signing(bench)
    key = bench.folder / "arm.key"
    for spoil, message in (
        (lambda: key.chmod(0o644), "signing.key: .* can be read by others"),
        (key.unlink, "signing.key: .* does not exist|No such file"),
    ):
        spoil()
        with bench.daemon() as daemon:
            assert await daemon.ended() == 2
        assert re.search(message, daemon.log), daemon.log
    key.touch(0o600)
    message = run("points", "key", "--out", key, status=2)
    assert "exists" in message
