"""A real mosquitto on loopback, started and stopped by tests."""

import contextlib
import os
import pwd
import random
import socket
import subprocess
import time
from collections.abc import Iterable
from pathlib import Path

HOST = "127.0.0.1"
START_S = 10.0
STOP_TRIES = 20
PORTS = (16_384, 32_768)  # Linux assigns higher ones to outgoing connections


def free_port() -> int:
    """A free port that no outgoing connection gets in the meantime."""
    chance = random.SystemRandom()  # seeded alike, two processes would draw the same
    while True:
        port = chance.randrange(*PORTS)
        with socket.socket() as probe, contextlib.suppress(OSError):
            probe.bind((HOST, port))
            return port


class Mosquitto:
    """A broker with a port of its own, kept over stops and starts.

    Args:
        folder: for its configuration and log.
        passwords: user names and passwords; empty: all clients are accepted.
        lines: more of its configuration, about the listener or the broker.
        acl: its access list; None: all clients may read and write all.
        program: path or name of mosquitto.
    """

    host = HOST

    def __init__(
        self,
        folder: Path,
        passwords: dict[str, str] | None = None,
        lines: Iterable[str] = (),
        acl: Path | None = None,
        program: str = "mosquitto",
    ) -> None:
        self._program = program
        self.port = free_port()
        self._log = folder / f"mosquitto-{self.port}.log"
        self._config = folder / f"mosquitto-{self.port}.conf"
        config = [
            f"listener {self.port} {HOST}",
            "persistence false",
            f"user {pwd.getpwuid(os.getuid()).pw_name}",
            f"allow_anonymous {'false' if passwords else 'true'}",
            *lines,
        ]
        if passwords:
            file = folder / f"passwords-{self.port}"
            text = "".join(f"{name}:{word}\n" for name, word in passwords.items())
            file.write_text(text)
            subprocess.run(["mosquitto_passwd", "-U", str(file)], check=True)
            config.append(f"password_file {file}")
        self._acl = folder / f"acl-{self.port}"
        self.allow_writing("#")
        config.append(f"acl_file {acl or self._acl}")
        self._config.write_text("\n".join(config) + "\n")
        self._process: subprocess.Popen[bytes] | None = None

    def allow_writing(self, *topics: str) -> None:
        """Allow topics for publishing, from the next start on; all may be read."""
        may = ["topic read #", *(f"topic write {topic}" for topic in topics)]
        # Without a user's name they apply to no one; as patterns to all.
        text = "\n".join(line.replace("topic", "pattern") for line in may)
        self._acl.write_text(text + "\n")

    def start(self) -> None:
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(
                [self._program, "-c", str(self._config)], stdout=log, stderr=log
            )
        until_s = time.monotonic() + START_S
        while time.monotonic() < until_s and self._process.poll() is None:
            with socket.socket() as probe:
                if probe.connect_ex((HOST, self.port)) == 0:
                    return
            time.sleep(0.02)
        self.kill()
        raise AssertionError(f"mosquitto did not start: {self._log.read_text()}")

    def stop(self) -> None:
        """End it in order; may be called again."""
        process = self._process
        if process is None:
            return
        # One that listens and is not yet in its loop forgets the signal (2.0.21).
        for _ in range(STOP_TRIES):
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(1.0)
                self._process = None
                return
        self.kill()
        raise AssertionError(f"mosquitto did not end: {self._log.read_text()}")

    def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None
