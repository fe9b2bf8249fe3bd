"""`python -m benchmarks.clients.screenshots FOLDER`: pictures of the page for docs/.

A real broker, a simulated arm that measures a ball bar, a sphere and a cone, its daemon
and the page, in Chromium: what is seen is what the page shows.
"""

import asyncio
import shutil
import sys
import tempfile
from pathlib import Path

from benchmarks.clients.page import browser
from benchmarks.tools import rig

DEMO = Path(__file__).parent.parent.parent / "cli" / "demo_data"


async def pictures(folder: Path, out: Path) -> None:
    """Take all pictures."""
    port = rig.free_port()
    for name in ("arm.toml", "simulator.toml"):
        shutil.copy(DEMO / name, folder)
    with rig.mosquitto(folder, port) as broker:
        run = (sys.executable, "-m", "traverse", "simulate", "--config")
        log = folder / "simulator.log"
        with rig.program(log, *run, str(folder / "simulator.toml")):
            rig.wait_for((folder / "board.pty").exists, "the simulated board")
            with rig.daemon(folder, port):
                async with browser(folder, port) as page:
                    await page.keyboard.press("l")
                    await page.get_by_label("Artefact").fill("bar")
                    await page.get_by_role("button", name="Set").click()
                    await page.keyboard.press("s")
                    await page.wait_for_function("traverse_scene.points.size > 14")
                    await page.screenshot(path=out / "page-measuring.png")
                    await page.keyboard.press("s")
                    await page.keyboard.press("d")
                    await asyncio.sleep(1.0)
                    await page.screenshot(path=out / "page-light.png")
                    await page.keyboard.press("d")
                    broker.kill()
                    await page.get_by_text("No connection to the broker").wait_for()
                    await asyncio.sleep(1.0)
                    await page.screenshot(path=out / "page-broker-gone.png")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        asyncio.run(pictures(Path(temporary), Path(sys.argv[1])))
