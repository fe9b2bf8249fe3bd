"""The page's unit and the second package, as an administrator adds them."""

import asyncio
import http.client
import os
import subprocess

from tests.vm.system import guard_checks, unit
from tests.vm.system.preparation import FOLDER, OPERATOR, PASSWORDS
from tests.vm.system.unit import ARM

NAME = f"traverse-page@{ARM}.service"
PORT = 8080
TOKEN = "a-token-of-the-guest"
START_S = 200.0
OPTIONS = f"--username={OPERATOR} --password-file=credential:page.password"


async def ask() -> str:
    """No start without a token; with one the page is for those who have it."""
    ran = subprocess.run(["systemctl", "start", NAME], check=False)  # noqa: ASYNC221
    assert ran.returncode != 0, "it has started without a token"
    for name, text in (("token", TOKEN), ("password", PASSWORDS[OPERATOR])):
        file = FOLDER / f"page.{name}"
        file.touch(mode=0o600)
        file.write_text(f"{text}\n", "utf-8")
    environment = FOLDER / "environment"
    environment.write_text(f"TRAVERSE_PAGE_OPTIONS={OPTIONS}\n", "utf-8")
    await asyncio.to_thread(unit.systemctl, "start", NAME)
    await unit.until(lambda: answer() == 303, "the page answers", START_S)
    assert answer("not-the-token-at-all") == 401
    assert answer(TOKEN) == 303
    pid = unit.systemctl("show", NAME, "--property", "MainPID", "--value")
    user = unit.run("ps", "-o", "user=", "-p", pid)
    assert user.strip() not in {"root", "traverse"}, user
    journal = unit.run("journalctl", "--no-pager", "--output=cat", "--unit", NAME)
    assert "Traceback" not in journal, journal
    assert TOKEN not in journal
    return f"refused without; 401, 303 with it; user {user.strip()[:12]}"


def answer(token: str | None = None) -> int:
    connection = http.client.HTTPConnection("127.0.0.1", PORT, timeout=60)
    try:
        if token is None:
            connection.request("GET", "/")
        else:
            connection.request("POST", "/login", f"token={token}")
        return connection.getresponse().status
    except ConnectionRefusedError:
        return 0
    finally:
        connection.close()


def be_shut() -> str:
    """Its exposure; then it is off again."""
    result = guard_checks.be_shut(NAME)
    unit.systemctl("stop", NAME)
    return result


def add_lab() -> str:
    """The command names the package that it lacks, and finds it once it is there."""
    arm, history = FOLDER / "arm.toml", FOLDER / "history.db"
    words = ["traverse", "daily-check", "--arm", str(arm), "--show"]

    def shown() -> str:
        run = [*words, "--history", str(history)]
        ran = subprocess.run(run, capture_output=True, text=True, check=False)
        assert ran.returncode == 2, ran.stderr
        return ran.stderr

    before = shown()
    assert "sudo apt-get install ./traverse-lab_" in before, before
    unit.run("dpkg", "-i", f"{os.environ['TRAVERSE_VM_OUT']}/traverse-lab.deb")
    after = shown()
    assert "has no check of arm" in after, after
    return before.strip().rpartition("; ")[2]
