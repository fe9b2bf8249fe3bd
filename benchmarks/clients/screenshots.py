"""`python -m benchmarks.clients.screenshots FOLDER`: pictures of the page for docs/.

A real broker, a simulated arm that measures a ball bar, a sphere and a cone, its daemon
and the page, in Chromium: what is seen is what the page shows.
"""

import asyncio
import contextlib
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from playwright.async_api import Page

from benchmarks.clients.page import browser
from benchmarks.tools import rig

DEMO = Path(__file__).parent.parent.parent / "cli" / "demo_data"
SIZES = {"desk": (1440, 900), "tablet": (820, 1180), "phone": (390, 844)}
# An encoder says that its count is not valid, as long as the picture takes.
DOUBT = '[[fault]]\nkind = "status"\nchannel = 2\nat_s = 0.1\nduration_s = 1000.0\n'
REST = '[[motion]]\nkind = "rest"\nduration_s = 1000.0\n'


@contextlib.contextmanager
def simulated(folder: Path, *, in_doubt: bool = False) -> Iterator[None]:
    """The arm of the demonstration; or at rest, with an encoder that fails."""
    text = (DEMO / "simulator.toml").read_text("utf-8")
    if in_doubt:
        text = text[: text.index("[[motion]]")].replace('"first_start"', "0.0")
        text += REST + DOUBT
    (folder / "simulator.toml").write_text(text, "utf-8")
    run = (sys.executable, "-m", "traverse", "simulate", "--config")
    log = folder / "simulator.log"
    with rig.program(log, *run, str(folder / "simulator.toml")):
        rig.wait_for((folder / "board.pty").exists, "the simulated board")
        yield
    (folder / "board.pty").unlink(missing_ok=True)


async def picture(page: Page, out: Path, state: str) -> None:
    """One state in all sizes, dark and light."""
    for theme in ("dark", "light"):
        for name, (width, height) in SIZES.items():
            await page.set_viewport_size({"width": width, "height": height})
            await asyncio.sleep(1.0)
            await page.screenshot(path=out / f"page-{state}-{name}-{theme}.png")
        await page.keyboard.press("d")


async def pictures(out: Path, folder: Path, broker: "subprocess.Popen[bytes]") -> None:
    """Take all pictures."""


async def main(folder: Path, out: Path) -> None:
    """Start everything, and bring it into one state after the other."""
    port = rig.free_port()
    shutil.copy(DEMO / "arm.toml", folder)

    async def says(page: Page, word: str) -> None:
        await page.locator(".word").get_by_text(word).wait_for()

    with rig.mosquitto(folder, port) as broker, simulated(folder):
        with rig.daemon(folder, port):
            async with browser(folder, port) as page:
                await page.keyboard.press("l")
                await page.get_by_label("Artefact").fill("bar")
                await page.get_by_role("button", name="Set").click()
                await page.wait_for_function("traverse_scene.points.size > 14")
                await picture(page, out, "ready")
                await page.keyboard.press("s")
                await says(page, "Scanning")
                await picture(page, out, "scanning")
                await page.keyboard.press("s")
                broker.kill()
                await says(page, "Broker gone")
                await picture(page, out, "broker-gone")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        asyncio.run(main(Path(temporary), Path(sys.argv[1])))
