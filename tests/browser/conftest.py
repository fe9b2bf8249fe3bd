"""A real Chromium, a real broker, a simulated arm, its daemon and the page."""

import asyncio
import contextlib
import shutil
import signal
import socket
import time
import uuid
from collections.abc import AsyncIterator, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import pytest
import pytest_asyncio
from playwright.async_api import Browser, Page, async_playwright, expect

from tests.client.display.values import health, live
from tests.client.virtual_daemon import VirtualDaemon
from tests.conftest import no_task_stays
from tests.end_to_end.programs import Program
from tests.end_to_end.workbench import Workbench
from tests.mosquitto import HOST, Mosquitto, free_port
from traverse.client.cancel_tasks import cancel_tasks
from traverse.protocol.messages import Point, Quality
from traverse.testing.waiting import until

expect.set_options(timeout=20_000)  # a busy machine is no fault
# There is no graphics card in a container, and no user whom a sandbox could keep apart.
OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
# A processor draws: a quarter of the work without smooth edges and layers as textures.
OPTIONS += [
    "--disable-gpu-compositing",
    "--disable-gpu-rasterization",
    "--webgl-antialiasing-mode=none",
]
# Each pose is drawn, without a graphics card: most of what these tests compute.
HEALTH_NS = 2_000_000_000
POSE_S = 0.25
POINTS = (
    '[[motion]]\nkind = "rest"\nduration_s = 0.5\n'
    '[[motion]]\nkind = "sphere"\nartefact = "ball"\n'
    "centre_mm = [700.0, 100.0, 120.0]\nradius_mm = 50.8\npoints = 3\n"
    '[[motion]]\nkind = "rest"\nduration_s = 1000.0'
)


@dataclass
class Scene:
    bench: Workbench
    broker: Mosquitto
    simulator: Program
    daemon: Program
    page: Page


@pytest.fixture
def own_broker(tmp_path: Path) -> Iterator[Mosquitto]:
    broker = Mosquitto(tmp_path)
    broker.start()
    yield broker
    broker.stop()


@pytest_asyncio.fixture(loop_scope="session", scope="session")
async def chromium() -> AsyncIterator[Browser]:
    """The browser of all tests of a worker; every page has a profile of its own."""
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=OPTIONS
        )
        yield browser
        await browser.close()


@pytest_asyncio.fixture(loop_scope="session")
async def _no_task() -> AsyncIterator[None]:
    """As for all tests, in the loop that the browser lives in; likewise threads."""
    with ThreadPoolExecutor() as threads:
        asyncio.get_running_loop().set_default_executor(threads)
        async with no_task_stays():
            yield


class OpenPage(Protocol):
    def __call__(
        self, arm: str, broker: str, **options: Any
    ) -> contextlib.AbstractAsyncContextManager[Page]:
        """Serve the page, by a server of its own, in a profile of its own.

        Args:
            arm: its name.
            broker: its address.
            options: of the browser's context.
        """


class ServePage(Protocol):
    def __call__(
        self, arm: str, broker: str, **options: Any
    ) -> contextlib.AbstractAsyncContextManager[tuple[Page, Program]]: ...


@pytest.fixture
def served_page(chromium: Browser, tmp_path: Path) -> OpenPage:
    return partial(_served_page, chromium, tmp_path)


@pytest.fixture
def page_and_server(chromium: Browser, tmp_path: Path) -> ServePage:
    return partial(_page_and_server, chromium, tmp_path)


@contextlib.asynccontextmanager
async def _served_page(
    browser: Browser, folder: Path, arm: str, broker: str, **options: Any
) -> AsyncIterator[Page]:
    serving = _page_and_server(browser, folder, arm, broker, **options)
    async with serving as (page, server):
        yield page
        assert server.process.poll() is None, server.log


async def hears_server(page: Page) -> None:
    """Wait until an opened page can state the time of a press.

    A press before that is refused, since nobody knows how old it is.
    """
    await page.wait_for_function("traverse_watch.beats > 0", polling=100)


async def settled(page: Page) -> None:
    """Wait until nothing moves to its place or colour any more."""
    await page.wait_for_function(
        "document.getAnimations().every(a => a.playState !== 'running'"
        " || a.effect.getComputedTiming().endTime === Infinity)",
        polling=100,
    )


async def change_theme(page: Page) -> None:
    """Change from light to dark or back, by the key."""
    is_dark = "document.body.classList.contains('body--dark')"
    before = await page.evaluate(is_dark)
    await page.keyboard.press("d")
    await page.wait_for_function(
        f"before => {is_dark} !== before", arg=before, polling=100
    )
    await settled(page)


@contextlib.asynccontextmanager
async def _page_and_server(
    browser: Browser, folder: Path, arm: str, broker: str, **options: Any
) -> AsyncIterator[tuple[Page, Program]]:
    errors: list[str] = []
    port = free_port()
    where = ["--arm-name", arm, "--broker", broker, "--port", str(port)]
    with Program(folder, f"page-{port}", "page", *where) as server:
        await server.says(f"http://{HOST}:{port}")
        await until(partial(_listens, port), "the page's server listens")
        size = {"viewport": {"width": 1600, "height": 900}}
        async with await browser.new_page(**(size | options)) as page:
            page.set_default_timeout(20_000)
            page.on("pageerror", lambda error: errors.append(str(error)))
            await page.goto(f"http://{HOST}:{port}/")
            await hears_server(page)
            yield page, server
        if server.process.poll() is None:
            assert await server.stop() in (0, -signal.SIGTERM), server.log
    assert errors == []


@pytest_asyncio.fixture(loop_scope="session")
async def scene(
    own_broker: Mosquitto, served_page: OpenPage, tmp_path: Path
) -> AsyncIterator[Scene]:
    """The page of an arm that takes three points by itself, in a browser."""
    bench = Workbench(tmp_path, own_broker.host, own_broker.port)
    bench.write_simulator(POINTS)
    bench.write_daemon(capture=f"live_rate_hz = {1.0 / POSE_S}")
    broker = f"{own_broker.host}:{own_broker.port}"
    with bench.simulator() as simulator:
        await simulator.says("ready base")
        async with served_page(bench.arm, broker) as page:
            with bench.daemon() as daemon:
                yield Scene(bench, own_broker, simulator, daemon, page)
                if daemon.process.poll() is None:
                    assert await daemon.stop() == 0
        await simulator.stop()


class PosedDaemon(VirtualDaemon):
    """A simulated daemon whose arm rests, and which publishes its pose continuously.

    Attributes:
        pose: fields of the live poses that are sent.
    """

    def __init__(self, arm: str, host: str, port: int) -> None:
        super().__init__(arm, host, port)
        self.pose: dict[str, Any] = {
            "quality": {"ok": True, "flags": []},
            "part_xyz_mm": None,
        }

    @contextlib.asynccontextmanager
    async def posing(self) -> AsyncIterator["PosedDaemon"]:
        async with self.running():
            sending = asyncio.create_task(self._send_poses())
            try:
                yield self
            finally:
                await cancel_tasks([sending])

    async def touch(self, *xyz_mm: float, **fields: Any) -> Point:
        made = self._next_point()
        fine = {"quality": Quality(ok=True, flags=()), "xyz_mm": xyz_mm}
        changes = {"time_ns": time.time_ns(), "part_xyz_mm": None, **fine, **fields}
        point = made.model_copy(update=changes)
        self.outbox[self.session][point.seq] = point
        await self.publish(point)
        return point

    async def _send_poses(self) -> None:
        begun_ns, figures_ns = time.monotonic_ns(), -HEALTH_NS
        while True:
            await asyncio.sleep(POSE_S)
            if self.is_stopped:
                continue
            now_ns = time.monotonic_ns() - begun_ns
            fields = {"arm": self.arm, "time_ns": str(time.time_ns())}
            if now_ns - figures_ns >= HEALTH_NS:
                figures_ns = now_ns
                figures = health(**fields)
                sent = {"unsent": 0, "oldest_unsent_ns": None}
                outbox = figures.outbox.model_copy(update=sent)
                await self.publish(figures.model_copy(update={"outbox": outbox}))
            await self.publish(live(**(fields | self.pose)))


@pytest.fixture
def posed(own_broker: Mosquitto) -> PosedDaemon:
    name = f"arm-{uuid.uuid4().hex[:8]}"
    return PosedDaemon(name, own_broker.host, own_broker.port)


@pytest.fixture
def address(own_broker: Mosquitto) -> str:
    return f"{own_broker.host}:{own_broker.port}"


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex((HOST, port)) == 0
