"""The broker's configuration, beside Debian's own, starts a real mosquitto."""

import os
import pwd
import re
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.deploy.places import DEPLOY, output_of, program
from tests.mosquitto import HOST, free_port

FILE = DEPLOY / "mosquitto/traverse.conf"
# As /etc/mosquitto/mosquitto.conf of Debian 12.
DEBIAN = """\
user {user}
pid_file {folder}/mosquitto.pid
persistence true
persistence_location {folder}/
log_dest file {folder}/mosquitto.log
include_dir {folder}/conf.d
"""
START_S = 10.0

pytestmark = pytest.mark.needs("mosquitto", "openssl")


def adapted(folder: Path, port: int, tls_port: int) -> str:
    """Our file with the test's ports and folder, and TLS switched on."""
    text = FILE.read_text("utf-8")
    text = re.sub(r"(?m)^#(?=[a-z_]+ )", "", text)
    text = re.sub(r"(?m)^#(?=listener )", "", text)
    text = text.replace("listener 1883 ", f"listener {port} ")
    text = text.replace("listener 8883", f"listener {tls_port} {HOST}")
    return re.sub(r"/etc/mosquitto/(?:\w+/)?", f"{folder}/", text)


def write_secrets(folder: Path) -> None:
    """Certificates of a day, a password and the rights."""
    openssl = program("openssl")
    for name in ("traverse-ca", "broker"):
        output_of(
            *(openssl, "req", "-x509", "-newkey", "ec", "-nodes", "-days", "1"),
            *("-pkeyopt", "ec_paramgen_curve:prime256v1"),
            *("-subj", f"/CN={name}", "-keyout", folder / f"{name}.key"),
            *("-out", folder / f"{name}.crt"),
        )
    passwords = folder / "traverse.passwords"
    passwords.write_text("bench-7:word\n", "utf-8")
    output_of(program("mosquitto_passwd"), "-U", passwords)
    acl = folder / "traverse.acl"
    acl.write_text("topic read $SYS/#\n", "utf-8")
    for file in (passwords, acl):
        file.chmod(0o700)  # newer brokers warn of files that others can read


@contextmanager
def running(folder: Path, *ports: int) -> Iterator[str]:
    """Run the broker while the block lasts; yield its log."""
    user = pwd.getpwuid(os.getuid()).pw_name
    main = folder / "mosquitto.conf"
    main.write_text(DEBIAN.format(user=user, folder=folder), "utf-8")
    with subprocess.Popen([program("mosquitto"), "-c", main]) as process:
        try:
            until_s = time.monotonic() + START_S
            while not all(listens(port) for port in ports):
                assert process.poll() is None, (folder / "mosquitto.log").read_text()
                assert time.monotonic() < until_s, "it does not listen"
                time.sleep(0.02)
            yield (folder / "mosquitto.log").read_text("utf-8")
        finally:
            process.terminate()


def listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex((HOST, port)) == 0


def test_mosquitto_starts_with_it_beside_debians_own_file(tmp_path: Path) -> None:
    port, tls_port = free_port(), free_port()
    (tmp_path / "conf.d").mkdir()
    write_secrets(tmp_path)
    text = adapted(tmp_path, port, tls_port)
    (tmp_path / "conf.d/traverse.conf").write_text(text, "utf-8")
    with running(tmp_path, port, tls_port) as log:
        assert "Error" not in log
        assert "Warning" not in log
    assert f"listener {tls_port}" in text
    assert "\nrequire_certificate true" in text
