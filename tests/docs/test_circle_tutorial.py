"""The tutorial on I++ DME gives its page's figures, to the last printed digit."""

import re
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.docs.accounts import why_not_run
from tests.docs.pages import commands, text_of, write_configurations
from tests.docs.shell import Shell, as_run
from tests.established import believe_utc
from tests.mosquitto import Mosquitto

PAGE = "docs/tutorial/circle-over-ippdme.md"
PRINTED = re.compile(r"^Tool\.Name.*?form [0-9.]+ mm$", re.DOTALL | re.MULTILINE)


@pytest.mark.slow
@pytest.mark.needs("mosquitto")
async def test_a_circle(
    make_mosquitto: Callable[..., Mosquitto], tmp_path: Path
) -> None:
    port = make_mosquitto().port
    believe_utc(tmp_path)
    write_configurations(PAGE, tmp_path, port)
    lines = [line for line in commands(PAGE) if why_not_run(line) is None]
    copy, simulate, run, serve, confirm, measure = [
        as_run(line, port) for line in lines
    ]
    measure = measure.replace("python", sys.executable, 1)
    with Shell(tmp_path, "copy", copy) as copying:
        await copying.ends()
    with Shell(tmp_path, "simulate", simulate) as simulator:
        await simulator.says("ready base board.pty\n")
        with (
            Shell(tmp_path, "run", run) as daemon,
            Shell(tmp_path, "serve", f"{serve} --listen 0") as gateway,
        ):
            await daemon.says("button.pressed")
            await gateway.says("I++ DME server of demo-7 on tcp 127.0.0.1:")
            where = gateway.output.split("127.0.0.1:")[1].split()[0]
            with Shell(tmp_path, "confirm", confirm) as confirming:
                confirmed = await confirming.ends()
            assert f"$ traverse confirm\n{confirmed}```" in text_of(PAGE)
            with Shell(tmp_path, "measure", f"{measure} {where}") as client:
                conversation = await client.ends()
            await gateway.interrupt()
            await daemon.interrupt()
        await simulator.interrupt()
    match = PRINTED.search(text_of(PAGE))
    assert match is not None
    # Touches before the round began are warned of; how many, depends on the start.
    measured = [
        line for line in conversation.splitlines() if " ! Error(1,1001," not in line
    ]
    assert measured == match[0].splitlines()
