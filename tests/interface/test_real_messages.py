"""Messages of a real daemon, as a real broker hands them to others."""

import asyncio
import contextlib
import json
import shutil
import subprocess
from collections.abc import AsyncIterator
from pathlib import Path

import aiomqtt
import pytest

from tests.end_to_end.measuring import measuring
from tests.end_to_end.programs import PATIENCE_S
from tests.end_to_end.workbench import SPHERE, Workbench
from tests.interface.conftest import ROOT
from tests.interface.test_asyncapi import validator
from tests.mosquitto import Mosquitto
from traverse.protocol.messages import ScanArgs
from traverse.testing.waiting import until

pytestmark = pytest.mark.needs("mosquitto", "node")

GOLDEN = ROOT / "tests" / "protocol" / "golden"


@pytest.fixture
def bench(mosquitto: Mosquitto, tmp_path: Path) -> Workbench:
    """An arm that is led over a sphere again and again."""
    bench = Workbench(tmp_path, mosquitto.host, mosquitto.port)
    bench.write_simulator(SPHERE.format(points=4), top="repeat = true")
    return bench


async def test_all_that_a_daemon_says_is_good_by_the_published_schemas(
    bench: Workbench,
) -> None:
    bench.write_daemon(broker='encoding = "json"')
    kinds = {"status", "health", "live", "point", "scan", "event", "reply"}
    seen: set[str] = set()
    async with (
        aiomqtt.Client(bench.host, bench.port) as client,
        asyncio.timeout(2 * PATIENCE_S),
    ):
        await client.subscribe(f"traverse/{bench.arm}/#", qos=1)
        async with measuring(bench) as (listener, _, _):
            await listener.command(ScanArgs(action="start", rate_hz=100.0))
            async for message in client.messages:
                kind = str(message.topic).split("/")[2]
                assert isinstance(message.payload, bytes)
                if kind == "cmd":
                    continue
                validator(f"{kind}.schema.json").validate(json.loads(message.payload))
                seen.add(kind)
                if kinds <= seen:
                    break


@contextlib.asynccontextmanager
async def reading(script: Path, bench: Workbench) -> AsyncIterator[list[list[str]]]:
    """A reader from the documentation, run under node; yields words of its lines."""
    node = shutil.which("node")
    assert node is not None
    url = f"mqtt://{bench.host}:{bench.port}"
    process = await asyncio.create_subprocess_exec(
        node, script.name, url, bench.arm, cwd=script.parent, stdout=subprocess.PIPE
    )
    lines: list[list[str]] = []

    async def follow() -> None:
        assert process.stdout is not None
        while line := await process.stdout.readline():
            lines.append(line.decode().split())

    following = asyncio.create_task(follow())
    try:
        yield lines
    finally:
        process.kill()
        await process.wait()
        await following


@pytest.mark.parametrize(
    "encoding", ["msgpack", pytest.param("json", marks=pytest.mark.slow)]
)
async def test_the_reader_of_points_in_javascript_prints_what_was_captured(
    bench: Workbench, readers: Path, encoding: str
) -> None:
    bench.write_daemon(broker=f'encoding = "{encoding}"')
    async with (
        reading(readers / "points.mjs", bench) as lines,
        measuring(bench) as (listener, _, _),
    ):
        await until(lambda: len(lines) >= 3, "three points under node")
        printed = {(session, int(seq)): xyz for session, seq, *xyz in lines}
        captured = {}

        def heard() -> bool:  # node may have been quicker
            captured.update({(p.session, p.seq): p.xyz_mm for p in listener.points})
            return printed.keys() <= captured.keys()

        await until(heard, "the same points here")
    for point, xyz in printed.items():
        assert tuple(map(float, xyz[:3])) == captured[point]


async def test_the_reader_of_scans_in_javascript_takes_arrays_apart(
    bench: Workbench, readers: Path
) -> None:
    bench.write_daemon()
    async with (
        reading(readers / "scan.mjs", bench) as lines,
        measuring(bench) as (listener, _, _),
    ):
        await listener.command(ScanArgs(action="start", rate_hz=100.0))
        await until(lambda: len(lines) >= 3, "three blocks under node")
        printed = {(scan, int(seq)): numbers for scan, seq, *numbers in lines}
        blocks = {}

        def heard() -> bool:  # node may have been quicker
            blocks.update({(s.scan, s.seq): s for s in listener.scans})
            return printed.keys() <= blocks.keys()

        await until(heard, "the same blocks here")
    for key, (n, *numbers) in printed.items():
        block = blocks[key]
        assert int(n) == len(block.xyz_mm)
        assert [float(x) for x in numbers] == block.xyz_mm[-1].tolist()


def test_the_flow_of_node_red_decodes_each_point_once(
    node_modules: Path, readers: Path
) -> None:
    """Its functions run under node with Node-RED's arguments."""
    flow = json.loads((readers / "node-red.json").read_text("utf-8"))
    nodes = {node["id"]: node for node in flow}
    for node in flow:
        assert all(to in nodes for wire in node.get("wires", []) for to in wire)
    golden = GOLDEN / "point"
    packed = bytes.fromhex(golden.with_suffix(".msgpack.hex").read_text("utf-8"))
    point = json.loads(golden.with_suffix(".json").read_text("utf-8"))
    script = f"""
        import * as msgpack from "@msgpack/msgpack";
        const kept = new Map();
        const context = {{ get: (k) => kept.get(k), set: (k, v) => kept.set(k, v) }};
        const env = {{ get: () => "bench-9" }};
        const decode = (msg) => {{ {nodes["traverse-decode"]["func"]} }};
        const command = (msg) => {{ {nodes["traverse-command"]["func"]} }};
        const packed = Buffer.from("{packed.hex()}", "hex");
        const text = Buffer.from({json.dumps(json.dumps(point))});
        const first = decode({{ payload: packed }});
        kept.clear();
        const second = decode({{ payload: text }});
        const again = decode({{ payload: packed }});
        console.log(JSON.stringify([first, second, again, command({{}})]));
    """
    (readers / "flow.mjs").write_text(script, "utf-8")
    node = shutil.which("node")
    assert node is not None
    done = subprocess.run(
        [node, "flow.mjs"], cwd=readers, capture_output=True, check=True, timeout=30
    )
    first, second, repeated, command = json.loads(done.stdout)
    assert first["payload"] == second["payload"] == point
    assert repeated is None
    assert command["topic"] == "traverse/bench-9/cmd/point"
    validator("command-point.schema.json").validate(json.loads(command["payload"]))
