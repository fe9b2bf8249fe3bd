"""Real programs as processes: started, watched through their logs, always reaped."""

import os
import signal
import subprocess
from contextlib import AbstractContextManager, suppress
from pathlib import Path

from tests.warm_start import warm_start
from traverse.testing.waiting import until

PATIENCE_S = 20.0


class Program(AbstractContextManager["Program"]):
    """`python -m traverse ...`, its output in files; ends with its block.

    Args:
        folder: where it runs and where its output is stored.
        name: of the output's files.
        arguments: after `python -m traverse`.
    """

    def __init__(self, folder: Path, name: str, *arguments: str) -> None:
        self.name = name
        self._out, self._err = folder / f"{name}.out", folder / f"{name}.err"
        environment = {**os.environ, "PYTHONUNBUFFERED": "1", "TMPDIR": str(folder)}
        # NiceGUI behaves otherwise where it believes to be tested by its own means.
        environment.pop("PYTEST_CURRENT_TEST", None)
        with self._out.open("wb") as out, self._err.open("wb") as err:
            self.process = warm_start().start(
                arguments, folder, environment, stdout=out, stderr=err
            )

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        if kind is not None and self.process.poll() is None:
            # It may have programs of its own, which it ends on SIGTERM.
            self.process.terminate()
            with suppress(subprocess.TimeoutExpired):
                self.process.wait(PATIENCE_S)
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(PATIENCE_S)
        if kind is not None:  # pytest shows what was printed with the failure
            print(f"--- {self.name} (status {self.process.returncode})")  # noqa: T201
            print(self.output[-6000:], self.log[-6000:], sep="\n")  # noqa: T201

    @property
    def output(self) -> str:
        return self._out.read_text("utf-8")

    @property
    def log(self) -> str:
        return self._err.read_text("utf-8")

    async def says(self, text: str, timeout_s: float = PATIENCE_S) -> None:
        def has_said() -> bool:
            if text in self.output or text in self.log:
                return True
            assert self.process.poll() is None, f"{self.name} ended without {text!r}"
            return False

        await until(has_said, f"{self.name} says {text!r}", timeout_s)

    async def ended(self, timeout_s: float = PATIENCE_S) -> int:
        await until(
            lambda: self.process.poll() is not None, f"{self.name} ends", timeout_s
        )
        return self.process.wait()

    async def stop(self, number: int = signal.SIGTERM) -> int:
        self.process.send_signal(number)
        return await self.ended()
