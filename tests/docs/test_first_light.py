import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.docs.accounts import why_not_run
from tests.docs.pages import commands, text_of, write_configurations
from tests.docs.shell import Shell, answered, as_run
from tests.established import believe_utc
from tests.mosquitto import Mosquitto
from traverse.testing.waiting import until

PAGE = "docs/tutorial/first-light.md"


def skipped(line: str) -> bool:
    """Return whether another test runs a line, or none can."""
    return why_not_run(line) is not None or line == "make demo"


@pytest.mark.slow
@pytest.mark.needs("mosquitto")
async def test_every_part_by_hand(
    make_mosquitto: Callable[..., Mosquitto], tmp_path: Path
) -> None:
    port = make_mosquitto().port
    believe_utc(tmp_path)
    write_configurations(PAGE, tmp_path, port)
    lines = iter(commands(PAGE))

    def shell(name: str, words: str) -> Shell:
        """The next command of the page that has these words."""
        for line in lines:
            if words in line:
                return Shell(tmp_path, name, as_run(line, port))
            assert skipped(line), line
        raise AssertionError(f"the page has no more {words!r}")

    async def does(words: str) -> str:
        with shell("command", words) as command:
            return await command.ends()

    await does("cp ")
    printed = await does("check identified")
    assert printed == "identified.toml: valid arm file\n"
    assert await does("mosquitto_pub -t test") == "works\n"
    printed = await does("check simulator")
    assert printed == "simulator.toml: valid simulator configuration\n"
    with shell("simulate", "traverse simulate") as simulate:
        await simulate.says("ready base board.pty\n")
        with shell("run", "traverse run") as run:
            await run.says("button.pressed: button on")
            assert "arm demo-7, model 83fb9e78ba10\n" in run.output
            with shell("watch", "traverse watch") as watch:
                await watch.says(" mm  turns_uncertain,identity_unconfirmed\n")
                await watch.says(" health ")
                assert " status doubt; base ready; identity of base" in watch.output
                confirmed = await does("traverse confirm")
                assert f"$ traverse confirm\n{confirmed}```" in text_of(PAGE)
                await watch.says(" status ready; base ready\n")
                good = re.compile(r" status ready;.* point [^\n]* mm\n", re.DOTALL)
                await until(
                    lambda: good.search(watch.output) is not None, "a point in no doubt"
                )
                topic, _, status = (await does("mosquitto_sub")).partition(" ")
                assert topic == "traverse/demo-7/status"
                assert json.loads(status)["state"] == "ready"
                with shell("replies", "mosquitto_sub") as replies:
                    for number in (1, 2, 3):
                        line = as_run(next(lines), port)
                        assert f'"r-{number}"' in line
                        await answered(line, replies, f'"r-{number}","ok":true')
                await watch.says("ended with")
            await run.interrupt()
        await simulate.interrupt()
    assert all(skipped(line) for line in lines)
