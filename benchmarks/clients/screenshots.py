"""`python -m benchmarks.clients.screenshots FOLDER`: pictures of the page for docs/.

A real broker, a simulated arm that measures a ball bar, a sphere and a cone, its daemon
and the page in Chromium: pictures of the page. One for each
state, size of screen and theme: `page-<state>-<size>-<theme>.png`.
"""

import asyncio
import contextlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from playwright.async_api import Page

from benchmarks.clients.page import browser
from benchmarks.tools import rig
from benchmarks.tools.command_line import run_main
from benchmarks.tools.sizes import sized
from traverse.kinematics.arm_file.arm import read_arm

DEMO = Path(__file__).parent.parent.parent / "cli" / "demo_data"
DESK, TABLET, PHONE = (1440, 900), (820, 1180), (390, 844)
SIZES = sized({"desk": DESK, "tablet": TABLET, "phone": PHONE}, {"desk": DESK})
LONGEST_MS = 120_000
DWELL_S = sized(3.0, 0.5)  # at each point, so that pictures show the arm at rest
AT_REST = re.compile(r"^\d{1,2} mm/s$")
# Powered up anew, so that its encoders may count from another place; later without
# power, after the pictures of that.
SILENT_AT_S = sized(60.0, 25.0)
POWER_LOSS = f"""\
[[motion]]
kind = "rest"
duration_s = 1000.0

[[fault]]
kind = "silent"
at_s = {SILENT_AT_S}
duration_s = 1000.0
"""


@contextlib.contextmanager
def simulated(folder: Path, *, loses_power: bool = False) -> Iterator[None]:
    """The arm of the demonstration; or one at rest that loses power."""
    text = (DEMO / "simulator.toml").read_text("utf-8")
    text = text.replace("dwell_s = 0.12", f"dwell_s = {DWELL_S}")
    if loses_power:
        text = text[: text.index("[[motion]]")] + POWER_LOSS
    (folder / "simulator.toml").write_text(text, "utf-8")
    run = (sys.executable, "-m", "traverse", "simulate", "devices")
    with rig.program(folder / "sim.log", *run, str(folder / "simulator.toml")):
        rig.wait_for((folder / "board.pty").exists, "the simulated board")
        yield
        (folder / "board.pty").unlink(missing_ok=True)


async def pictures(page: Page, out: Path, word: str, state: str) -> None:
    """Picture one state in all sizes, dark and light, when the banner has the word."""
    shown_word = page.locator(".word").get_by_text(word, exact=True)
    await shown_word.wait_for(timeout=LONGEST_MS)
    for theme in ("dark", "light"):
        for size, (width, height) in SIZES.items():
            await page.set_viewport_size({"width": width, "height": height})
            # As on a touch screen: without the names of keys.
            shown = "none" if size != "desk" else "block"
            await page.add_style_tag(content=f".key {{ display: {shown} !important }}")
            await page.keyboard.press("f")
            await asyncio.sleep(1.0)
            if state == "ready":
                await page.get_by_text(AT_REST).wait_for(timeout=LONGEST_MS)
            await page.screenshot(path=out / f"page-{state}-{size}-{theme}.png")
        await page.keyboard.press("d")


async def stale_picture(
    page: Page, out: Path, server: "subprocess.Popen[bytes]"
) -> None:
    """Picture the page whose server was stopped, as the browser marks it."""
    width, height = DESK
    await page.set_viewport_size({"width": width, "height": height})
    server.send_signal(signal.SIGSTOP)
    try:
        await page.wait_for_selector("body.silent")
        await page.get_by_role("button", name="Take point").click(force=True)
        await asyncio.sleep(1.0)
        await page.screenshot(path=out / "page-stale-desk-dark.png")
    finally:
        server.send_signal(signal.SIGCONT)
    await page.wait_for_selector("body:not(.silent)")


async def take_pictures(folder: Path, out: Path) -> None:
    port = rig.free_port()
    shutil.copy(DEMO / "arm.toml", folder)
    shutil.copy(DEMO / "arm.cov.npz", folder)
    with (
        rig.mosquitto(folder, port) as broker,
        contextlib.ExitStack() as simulator,
    ):
        simulator.enter_context(simulated(folder))
        identified = read_arm(DEMO / "identified.toml")
        with rig.daemon(folder, port, arm=identified):
            async with browser(folder, port) as (page, server):
                await page.get_by_role("button", name="Confirm the arm's").click()
                await page.get_by_role("button", name="It is right").click()
                await page.keyboard.press("l")
                await page.get_by_label("Artefact").fill("bar")
                await page.get_by_role("button", name="Set").click()
                await page.wait_for_function("traverse_scene.points.size > 5")
                await pictures(page, out, "Ready", "ready")
                await page.keyboard.press("s")
                await pictures(page, out, "Scanning", "scanning")
                await page.keyboard.press("s")
                await stale_picture(page, out, server)
                simulator.close()
                with simulated(folder, loses_power=True):
                    await pictures(page, out, "In doubt", "in-doubt")
                    await pictures(page, out, "Alarm", "power-lost")
                    broker.kill()
                    await pictures(page, out, "Broker gone", "broker-gone")


def main(folder: Path) -> None:
    out = folder.resolve()
    with tempfile.TemporaryDirectory() as temporary, contextlib.chdir(temporary):
        asyncio.run(take_pictures(Path(), out))  # none shows a path of this machine


if __name__ == "__main__":
    run_main(main)
