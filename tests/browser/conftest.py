"""A real Chromium, a real broker, a simulated arm, its daemon and the page."""

import shutil
import signal
import socket
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from playwright.async_api import Page, async_playwright, expect

from tests.end_to_end.programs import Program
from tests.end_to_end.workbench import Workbench
from tests.mosquitto import Mosquitto

expect.set_options(timeout=20_000)  # a busy machine is no fault
# There is no graphics card in a container, and no user whom a sandbox could keep apart.
OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
POINTS = (
    '[[motion]]\nkind = "rest"\nduration_s = 0.5\n'
    '[[motion]]\nkind = "sphere"\nartefact = "ball"\n'
    "centre_mm = [700.0, 100.0, 120.0]\nradius_mm = 50.8\npoints = 3\n"
    '[[motion]]\nkind = "rest"\nduration_s = 1000.0'
)


@dataclass
class Scene:
    """Everything at work.

    Attributes:
        errors: what the browser complained of.
    """

    bench: Workbench
    broker: Mosquitto
    simulator: Program
    daemon: Program
    page: Page
    errors: list[str]


@pytest.fixture
def own_broker(tmp_path: Path) -> Iterator[Mosquitto]:
    """A broker that a test may kill."""
    broker = Mosquitto(tmp_path)
    broker.start()
    yield broker
    broker.stop()


@pytest.fixture
async def scene(
    own_broker: Mosquitto, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[Scene]:
    """The page of an arm that takes three points by itself, in a browser."""
    # NiceGUI behaves otherwise where it believes to be tested by its own means.
    monkeypatch.delenv("PYTEST_CURRENT_TEST", raising=False)
    bench = Workbench(tmp_path, own_broker.host, own_broker.port)
    bench.write_simulator(POINTS)
    bench.write_daemon()
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    broker = f"{own_broker.host}:{own_broker.port}"
    options = ["--arm", bench.arm, "--broker", broker, "--port", str(port)]
    with bench.simulator() as simulator:
        await simulator.says("ready base")
        with Program(tmp_path, "page", "page", *options) as server:
            await server.says(f"http://127.0.0.1:{port}")
            async with async_playwright() as playwright:
                browser = await playwright.chromium.launch(
                    executable_path=shutil.which("chromium"), args=OPTIONS
                )
                page = await browser.new_page(viewport={"width": 1600, "height": 900})
                page.set_default_timeout(20_000)
                errors: list[str] = []
                page.on("pageerror", lambda error: errors.append(str(error)))
                await _opened(page, port)
                with bench.daemon() as daemon:
                    yield Scene(bench, own_broker, simulator, daemon, page, errors)
                    if daemon.process.poll() is None:
                        assert await daemon.stop() == 0
                await browser.close()
            assert await server.stop() in (0, -signal.SIGTERM), server.log
        await simulator.stop()
    assert errors == []


async def _opened(page: Page, port: int) -> None:
    """Open the page as soon as its server listens."""
    for _ in range(100):
        try:
            await page.goto(f"http://127.0.0.1:{port}/")
        except Exception as error:
            if "ERR_CONNECTION_REFUSED" not in str(error):
                raise
            await page.wait_for_timeout(100)
        else:
            return
    raise AssertionError("the page's server does not listen")
