"""Commands of a page, run in a shell as by a reader, until their output suffices."""

import asyncio
import os
import re
import signal
import subprocess
import sys
from contextlib import AbstractContextManager
from pathlib import Path

from tests.docs.pages import CHECKOUT
from traverse.testing.waiting import until

PATIENCE_S = 30.0


def as_run(command: str, port: int) -> str:
    """A command of a page for this checkout, and for a broker on another port."""
    where = f"127.0.0.1:{port}"
    line = re.sub(r"\b(mosquitto_(?:sub|pub))\b", rf"\1 -p {port}", command)
    if (
        re.search("traverse (confirm|watch|points resend|gateway)", line)
        and "--broker" not in line
    ):
        line += f" --broker {where}"
    line = re.sub(r"--broker \S+$|--broker \S+(?= )", f"--broker {where}", line)
    return re.sub(
        r"(?<![\w/.-])traverse (?=[a-z])", f"{sys.executable} -m traverse ", line
    )


class Shell(AbstractContextManager["Shell"]):
    """A line of shell in a folder; ends with its block, and all that it began.

    Args:
        folder: where it runs, and where its output is stored.
        name: of the output's file.
        line: the command.
    """

    def __init__(self, folder: Path, name: str, line: str) -> None:
        self.folder, self.line = folder, line
        self._out = folder / f"{name}.said"
        # In place of the shell, so that its end is the program's own.
        is_simple = re.search("[&|;]", line) is None
        with self._out.open("wb") as out:
            self.process = subprocess.Popen(
                ["/bin/sh", "-c", f"exec {line}" if is_simple else line],
                cwd=folder,
                env={
                    **os.environ,
                    "CHECKOUT": str(CHECKOUT),
                    "PYTHONUNBUFFERED": "1",
                    "OPENBLAS_NUM_THREADS": "1",
                },
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait(PATIENCE_S)
        if kind is not None:  # pytest shows it with the failure
            print(f"--- {self.line}\n{self.output[-4000:]}")  # noqa: T201

    @property
    def output(self) -> str:
        return self._out.read_text("utf-8")

    async def says(self, text: str) -> None:
        await until(
            lambda: text in self.output or self.process.poll() is not None,
            f"{self.line}: {text!r}",
            PATIENCE_S,
        )
        assert text in self.output, self.output

    async def ends(self) -> str:
        await until(
            lambda: self.process.poll() is not None, f"{self.line}: end", PATIENCE_S
        )
        assert self.process.returncode == 0, f"{self.line}\n{self.output}"
        return self.output

    async def interrupt(self) -> str:
        """Press Ctrl-C; return its output until it ended."""
        os.killpg(self.process.pid, signal.SIGINT)
        return await self.ends()


async def answered(line: str, listener: Shell, answer: str) -> None:
    """Send a command until its reply is received, since a listener may be late.

    The same request again is answered again, and not carried out again.
    """
    while answer not in listener.output:
        with Shell(listener.folder, "sent", line) as command:
            await command.ends()
        for _ in range(100):
            await asyncio.sleep(0.02)
            if answer in listener.output:
                return
