import asyncio
import contextlib
from functools import partial

import pytest
import pytest_asyncio
from playwright.async_api import expect

from tests.browser.conftest import _listens, settled
from tests.browser.test_accessible_page import findings
from tests.end_to_end.programs import Program
from tests.firmware.host_rig import HostBoard
from tests.interface.conftest import node_modules
from tests.mosquitto import HOST, free_port
from traverse.daemon.inputs import read_inputs
from traverse.kinematics.arm_file.arm import read_arm
from traverse.testing.waiting import until

__all__ = ["node_modules"]  # a fixture

pytestmark = pytest.mark.needs("compiler", "chromium", "mosquitto")

BITS = 12
QUARTER = 2 ** (BITS - 2)
TABLE = b"name,a_mm,d_mm,alpha_deg\nJ1,0,120,90\nJ2,250,0,0\nJ3,0,0,90\nJ4,0,220,-90\n"


@contextlib.asynccontextmanager
async def setup_page(browser, folder):
    errors, port = [], free_port()
    where = [str(folder / "traverse.toml"), "--port", str(port)]
    with Program(folder, f"setup-{port}", "setup", *where) as server:
        await server.says(f"http://{HOST}:{port}")
        await until(partial(_listens, port), "the page's server listens")
        async with await browser.new_page() as page:
            page.set_default_timeout(20_000)
            page.on("pageerror", lambda error: errors.append(str(error)))
            await page.goto(f"http://{HOST}:{port}/")
            yield page
        assert await server.stop() in (0, -15), server.log
    assert errors == []


def section(page, number):
    return page.locator(f'section[aria-label^="{number}."]')


async def press(place, name):
    await place.get_by_role("button", name=name, exact=True).click()


async def says(page, text):
    await expect(page.locator(".notice")).to_contain_text(text)


@pytest_asyncio.fixture(loop_scope="session")
async def board(tmp_path):
    with HostBoard(tmp_path / "port", "--channels", "4", "--bits", str(BITS)) as board:
        yield board


async def make_arm_file(page):
    """Have the arm file made of a table, after mistakes in the fields."""
    arm = section(page, 2)
    await arm.get_by_text("Make one of").click()
    await arm.locator("input[type=file]").set_input_files(
        {"name": "drawn.csv", "mimeType": "text/csv", "buffer": TABLE}
    )
    await says(page, "drawn.csv is here")
    await arm.get_by_label("Counts per turn").fill("many")
    await press(arm, "Make the arm file")
    await says(page, "convention")  # the table does not say it
    await choose(page, arm, "Convention of a table", "classic")
    await press(arm, "Make the arm file")
    await says(page, "'many'")
    await arm.get_by_label("Counts per turn").fill(str(2**BITS))
    await choose(page, arm, "Encoders", "absolute")
    await press(arm, "Make the arm file")
    await says(page, "drawn.toml is made")


async def choose(page, place, label, option):
    await place.get_by_label(label).click()
    await page.get_by_role("option", name=option).click()


async def set_broker(page, broker):
    form = section(page, 4)
    await form.get_by_label("port").fill(str(broker.port))
    await form.get_by_label("host").fill(HOST)
    await press(form, "Try it")
    await says(page, "answers")
    await press(form, "Set")


async def set_live_rate(page, text):
    await section(page, 5).get_by_label("live_rate_hz").fill(text)
    await press(section(page, 5), "Set")


async def turn_joints(page, board):
    """Turn J1 to J3, whose channels are 0, 2 and 1, the last one backwards."""
    joints = section(page, 7)
    prompt = joints.get_by_role("status")
    await press(joints, "Begin")
    for name, channel, count in (
        ("J1", 0, QUARTER),
        ("J2", 2, QUARTER),
        ("J3", 1, 3 * QUARTER),
    ):
        await expect(prompt).to_contain_text(f"{name}: turn it alone")
        await asyncio.to_thread(board.do, f"count {channel} {count}")
        if name == "J1":
            await expect(joints.locator("table")).to_contain_text(f"+{QUARTER}")
        await press(joints, "It is turned")
    await expect(prompt).to_contain_text("J4: turn it alone")
    await press(joints, "It is turned")
    await expect(prompt).to_contain_text("no channel has moved")
    await press(joints, "Leave it out")
    await says(page, "Not turned: J4")


@pytest.mark.slow
@pytest.mark.asyncio(loop_scope="session")
async def test_an_arm_is_set_up_from_nothing(
    chromium, board, own_broker, node_modules, tmp_path
):
    async with setup_page(chromium, tmp_path) as page:
        write = section(page, 6).get_by_role("button", name="Write")
        await expect(section(page, 6)).to_contain_text("device: is missing")
        await expect(write).to_be_disabled()
        await press(section(page, 1), "Another port")
        dialog = page.get_by_role("dialog")
        await dialog.get_by_label("port", exact=True).fill(str(board.link))
        await press(dialog, "Set")
        await says(page, "base is set")
        await make_arm_file(page)
        await press(section(page, 3), "Add")
        await says(page, "base/0 is added")
        await set_broker(page, own_broker)
        await section(page, 5).get_by_text("capture").click()
        await set_live_rate(page, "fast")
        await expect(section(page, 6)).to_contain_text("capture.live_rate_hz")
        await expect(write).to_be_disabled()
        await set_live_rate(page, "10")
        await write.click()
        await says(page, "is written")
        await turn_joints(page, board)
        await settled(page)
        axe = node_modules / "axe-core" / "axe.min.js"
        assert not (grave := await findings(page, axe)), grave

    inputs = read_inputs(tmp_path / "traverse.toml", embedded=False)
    assert inputs.configuration.capture.live_rate_hz == 10.0
    assert inputs.configuration.capture.inputs[0].source == "base/0"
    encoders = [joint.encoder for joint in read_arm(tmp_path / "drawn.toml").joints]
    assert [(encoder.source, encoder.sign) for encoder in encoders] == [
        ("base/0", 1),
        ("base/2", 1),
        ("base/1", -1),
        ("base/3", 1),
    ]
    assert len(list(tmp_path.glob("drawn.toml.*.old"))) == 1
