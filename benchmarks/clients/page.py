"""`python -m benchmarks.clients.page`: the operator's page in a real browser.

    latency [N]      from a point's instant to the frame that shows it
    million          a scan of 1.2 million points: drawn, thinned, memory, frames
    stream [MINUTES] a scan at 1 kHz: does the browser's memory grow?

All with mosquitto, a simulated arm, its daemon and the page's server as programs, and
Chromium without a graphics card, which draws by the processor: a real one is quicker.
"""

import asyncio
import contextlib
import shutil
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import AsyncIterator
from pathlib import Path

import aiomqtt
import numpy as np
from playwright.async_api import Page, async_playwright

from benchmarks.tools import rig
from benchmarks.tools.command_line import run_main
from benchmarks.tools.sizes import sized
from traverse.client.arm import Arm
from traverse.protocol.encoding import encode
from traverse.protocol.messages import Scan
from traverse.protocol.topics import scan_topic

ARM = "demo-7"
OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
BLOCK = 1000
N_POINTS = sized(100, 3)
N_SCANNED = sized(1_200_000, 20_000)  # more than are drawn
STREAM_MIN = sized(10.0, 0.05)
SETTLED_S = 60.0
PATIENCE_MS = 180_000  # WebGL without a graphics card, on a busy machine
TURNING_S = sized(5.0, 0.5)


@contextlib.asynccontextmanager
async def browser(
    folder: Path, port: int
) -> AsyncIterator[tuple[Page, "subprocess.Popen[bytes]"]]:
    """The page of the arm on a broker, in Chromium, and its server."""
    http = rig.free_port()
    command = [sys.executable, "-m", "traverse", "page", "--arm-name", ARM]
    where = ["--broker", f"127.0.0.1:{port}", "--port", str(http)]
    with rig.program(folder / "page.log", *command, *where) as server:
        rig.wait_for(lambda: rig.listens(http), "the page's server")
        async with async_playwright() as playwright:
            chromium = await playwright.chromium.launch(
                executable_path=shutil.which("chromium"), args=OPTIONS
            )
            page = await chromium.new_page(viewport={"width": 1600, "height": 900})
            page.set_default_timeout(PATIENCE_MS)
            await page.goto(f"http://127.0.0.1:{http}/")
            await page.wait_for_function("window.traverse_scene?.probe_mm")
            yield page, server
            await chromium.close()


async def heap_mb(page: Page) -> float:
    """Memory of the page's scripts, rubbish collected."""
    session = await page.context.new_cdp_session(page)
    await session.send("HeapProfiler.collectGarbage")
    used = await session.send("Runtime.getHeapUsage")
    await session.detach()
    return float(used["usedSize"] + used.get("backingStorageSize", 0.0)) * 1e-6


async def latency(page: Page, port: int, n: int) -> None:
    """Take points by command, and time their appearance on the screen."""
    waited_ms = []
    async with Arm(ARM, f"127.0.0.1:{port}") as arm:
        for _ in range(n):
            point = await arm.capture()
            script = "id => traverse_scene.drawn_ms[id]"
            shown = await page.wait_for_function(script, arg=point.id)
            waited_ms.append(await shown.json_value() - point.time_ns * 1e-6)
            await asyncio.sleep(0.05)
    p50, p95 = np.percentile(waited_ms, [50, 95])
    print(
        f"point to pixels, {n} points: p50 {p50:.0f} ms, p95 {p95:.0f} ms, "
        f"largest {max(waited_ms):.0f} ms"
    )


def blocks(n: int, scan: str) -> list[bytes]:
    """A scan over a wavy surface as messages."""
    rng = np.random.default_rng(1)
    payloads = []
    for first in range(0, n, BLOCK):
        s = np.arange(first, first + BLOCK) / n
        x, y = 400 * np.cos(400 * s) * s, 400 * np.sin(400 * s) * s
        z = 20 * np.sin(x / 40) + rng.normal(0, 0.05, BLOCK)
        message = Scan(
            session="benchmark",
            scan=scan,
            seq=first,
            arm=ARM,
            model="0",
            mode="time",
            rate_hz=10_000.0,
            probe_radius_mm=3.0,
            time_ns=time.time_ns(),
            dtime_ns=np.arange(BLOCK) * 100_000,
            xyz_mm=np.stack([700 + x, y, 100 + z], axis=1),
            ijk=np.tile([0.0, 0.0, -1.0], (BLOCK, 1)),
            angles_rad=np.zeros((BLOCK, 7)),
            counts=None,
            part_xyz_mm=None,
            covariance_mm2=None,
            quality=np.zeros(BLOCK, np.uint32),
            dropped=0,
            lost=0,
            in_doubt=0,
            last=False,
            total=None,
        )
        payloads.append(encode(message, "msgpack"))
    return payloads


async def million(page: Page, port: int) -> None:
    """Send more points than are drawn, at 50 000 a second."""
    before_mb = await heap_mb(page)
    print(f"page memory before {before_mb:.0f} MB")
    n = N_SCANNED
    messages = await asyncio.to_thread(blocks, n, uuid.uuid4().hex[:8])
    begun_s = time.monotonic()
    async with aiomqtt.Client("127.0.0.1", port) as client:
        for number, message in enumerate(messages):
            await client.publish(scan_topic(ARM), message)
            due_s = begun_s + (number + 1) * BLOCK / 50_000
            await asyncio.sleep(max(0.0, due_s - time.monotonic()))
            if number in (999, len(messages) - 1):
                await asyncio.sleep(2.0)
                await _print_state(page)
    first = await page.evaluate("traverse_scene.frames")
    begun_s = time.monotonic()
    await page.mouse.move(1000, 400)
    await page.mouse.down()
    step = 0
    while time.monotonic() - begun_s < TURNING_S:
        step += 1
        await page.mouse.move(1000 + 5 * (step % 100), 400)
    frames = await page.evaluate("traverse_scene.frames") - first
    elapsed_s = time.monotonic() - begun_s
    await page.mouse.up()
    print(f"{frames / elapsed_s:.1f} frames/s while the view is turned by hand")


async def _print_state(page: Page) -> None:
    note = await page.locator(".arm-scene-note").text_content()
    print(f"{note}; page memory {await heap_mb(page):.0f} MB")


async def stream(page: Page, port: int, minutes: float) -> None:
    """Scan long at 1 kHz, and read the memory every minute."""
    async with Arm(ARM, f"127.0.0.1:{port}") as arm:
        await arm.start_scan(rate_hz=1000.0)
        begun_s = time.monotonic()
        while (elapsed_s := time.monotonic() - begun_s) < 60 * minutes:
            await asyncio.sleep(min(SETTLED_S, 60 * minutes - elapsed_s))
            elapsed_s = time.monotonic() - begun_s
            note = await page.locator(".arm-scene-note").text_content()
            mb = await heap_mb(page)
            print(f"{elapsed_s / 60:5.1f} min  {mb:7.1f} MB  {note}", flush=True)
        await arm.stop_scan()


async def main(part: str = "all", amount: float | None = None) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder, port = Path(name), rig.free_port()
        with (
            rig.mosquitto(folder, port),
            rig.simulator(folder),
            rig.daemon(folder, port),
        ):
            async with browser(folder, port) as (page, _):
                if part in ("latency", "all"):
                    await latency(page, port, int(amount or N_POINTS))
                if part in ("million", "all"):
                    await million(page, port)
                if part in ("stream", "all"):
                    await stream(page, port, amount or STREAM_MIN)


if __name__ == "__main__":
    run_main(main)
