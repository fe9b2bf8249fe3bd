"""Guides that need no arm: every command of theirs, and its shown output."""

import os
import pwd
import re
import shutil
import socket
import ssl
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from tests.docs.accounts import why_not_run
from tests.docs.pages import CHECKOUT, commands, text_of
from tests.docs.shell import Shell, as_run
from tests.docs.telling import assert_printed, printed_blocks
from tests.end_to_end.workbench import REST, Workbench
from tests.mosquitto import HOST, free_port
from traverse.testing.waiting import until

ARM_FILES = "docs/how-to/arm-file-from-dh-or-urdf.md"
SECURE = "docs/how-to/secure-the-broker.md"
# The users who stand for those of the guide; Debian has them.
DAEMON, PERSON = "nobody", "games"
ROBOT = """\
<robot name="robot">
  <link name="base"/> <link name="upper"/> <link name="tool0"/>
  <joint name="J1" type="revolute">
    <parent link="base"/> <child link="upper"/>
    <origin xyz="0 0 0.2"/> <axis xyz="0 0 1"/>
  </joint>
  <joint name="J2" type="continuous">
    <parent link="upper"/> <child link="tool0"/>
    <origin xyz="0.3 0 0"/> <axis xyz="0 1 0"/>
  </joint>
</robot>
"""


@pytest.mark.slow
async def test_arm_files_are_made_and_shown_as_told(tmp_path: Path) -> None:
    table = re.search(r"^```text\n(name,.*?)^```$", text_of(ARM_FILES), re.M | re.S)
    assert table is not None
    (tmp_path / "ur10.csv").write_text(table[1], "utf-8")
    (tmp_path / "robot.urdf").write_text(ROBOT, "utf-8")
    for line, shown in printed_blocks(ARM_FILES):
        with Shell(tmp_path, "shown", as_run(line, 0)) as shell:
            printed = await shell.ends()
        assert_printed(printed, [line_ for line_ in shown if line_ != "..."], line)
    assert (tmp_path / "table.toml").exists()


@pytest.mark.slow
@pytest.mark.needs("openssl")
async def test_certificates_are_made_as_told(tmp_path: Path) -> None:
    lines = [line for line in commands(SECURE) if line.startswith(("openssl", "echo"))]
    assert len(lines) == 6
    for line in lines:
        assert why_not_run(line) is None
        # The page's authority has a passphrase, which is prompted for.
        unasked = line.replace("req -x509", "req -x509 -noenc")
        with Shell(tmp_path, "made", unasked) as shell:
            await shell.ends()
    verify = "openssl verify -CAfile authority.crt broker.crt"
    with Shell(tmp_path, "verified", verify) as shell:
        assert await shell.ends() == "broker.crt: OK\n"


def test_the_files_that_the_guide_copies_are_there() -> None:
    copied = [line.split()[1] for line in commands(SECURE) if line.startswith("cp ")]
    assert copied
    assert all((CHECKOUT / path).exists() for path in copied)


def _has_user(name: str) -> bool:
    return any(user.pw_name == name for user in pwd.getpwall())


def _as_user(name: str, line: str) -> str:
    """A line of shell as another user, without root's rights."""
    user = pwd.getpwnam(name)
    drop = "--clear-groups --bounding-set=-all --inh-caps=-all"
    ids = f"--reuid={user.pw_uid} --regid={user.pw_gid}"
    return f"setpriv {drop} {ids} {line}"


def _reaches_python(name: str) -> bool:
    line = _as_user(name, f"{sys.executable} -c 'import traverse.daemon.app'")
    return not subprocess.run(line, shell=True, check=False, cwd="/").returncode


def _mosquitto_folders(place: Path) -> Path:
    """Make the folders of Debian's /etc/mosquitto, readable by everybody."""
    place.chmod(0o755)
    for name in ("conf.d", "certs", "ca_certificates"):
        (place / "mosquitto" / name).mkdir(parents=True)
    return place / "mosquitto"


def _user_of(process: int) -> str:
    return pwd.getpwuid(Path(f"/proc/{process}").stat().st_uid).pw_name


@pytest.mark.slow
@pytest.mark.needs("mosquitto", "openssl")
@pytest.mark.skipif(
    os.geteuid() != 0 or not _has_user("mosquitto"),
    reason="only root can start a broker as the user mosquitto of Debian's package",
)
async def test_each_works_behind_tls_as_its_own_user_as_told(tmp_path: Path) -> None:
    """Broker, daemon and operator are three users who share no secret."""
    # Below /tmp: nobody but root reaches the folders of pytest.
    with tempfile.TemporaryDirectory() as place:
        etc = _mosquitto_folders(Path(place))
        (tmp_path / "deploy").symlink_to(CHECKOUT / "deploy")
        told_lines = commands(SECURE)
        end = next(n for n, line_ in enumerate(told_lines) if line_.startswith("sed "))
        home = Path(place) / "traverse" / "bench-7"
        home.mkdir(parents=True)
        for number, line in enumerate(told_lines[: end + 1]):
            if line.startswith("systemctl"):
                continue
            done = line.replace("/etc/mosquitto", str(etc))
            done = done.replace("req -x509", "req -x509 -noenc")
            done = done.replace("192.0.2.7", HOST)
            done = re.sub(r"^(mosquitto_passwd)(.*?)( #.*)?$", r"\1 -b\2 secret", done)
            if "/etc/traverse/bench-7" in done:
                done = done.replace("/etc/traverse/bench-7", str(home))
                done = "echo secret | " + done.replace("-o traverse", f"-o {DAEMON}")
            with Shell(tmp_path, f"done-{number}", done) as shell:
                await shell.ends()
        plain, port = free_port(), free_port()
        config = etc / "conf.d" / "traverse.conf"
        text = config.read_text("utf-8").replace("/etc/mosquitto", str(etc))
        text = text.replace("listener 1883", f"listener {plain}")
        text = text.replace("listener 8883", f"listener {port} {HOST}")
        config.write_text(text.replace("persistence true", "persistence false"))
        assert (etc / "certs" / "broker.key").stat().st_mode & 0o777 == 0o600
        assert (home / "broker.password").stat().st_mode & 0o777 == 0o600
        program = shutil.which("mosquitto", path=f"{os.environ['PATH']}:/usr/sbin")
        with Shell(tmp_path, "broker", f"{program} -c {config}") as broker:
            context = ssl.create_default_context(cafile=tmp_path / "authority.crt")

            def is_served() -> bool:
                assert broker.process.poll() is None, broker.output
                with socket.socket() as probe:
                    if probe.connect_ex((HOST, port)):
                        return False
                    with context.wrap_socket(probe, server_hostname="broker.lab"):
                        return True

            await until(is_served, "a broker with TLS")
            assert _user_of(broker.process.pid) == "mosquitto"
            if _reaches_python(DAEMON):
                shutil.copyfile(tmp_path / "authority.crt", home / "authority.crt")
                await _a_point_as_other_users(home, port)


async def _a_point_as_other_users(home: Path, port: int) -> None:
    bench = Workbench(home, HOST, port, "bench-7")
    bench.write_simulator(REST)
    shown = re.search(r"username = .*\npassword_file = .*\n", text_of(SECURE))
    assert shown is not None
    bench.write_daemon(broker=f'tls = true\nca_file = "authority.crt"\n{shown[0]}')
    person = home.parent / "person"
    person.mkdir()
    shutil.copyfile(home / "authority.crt", person / "authority.crt")
    (person / "operator.password").write_text("secret\n", "utf-8")
    (person / "operator.password").chmod(0o600)
    for folder, name in ((home, DAEMON), (person, PERSON)):
        folder.chmod(0o700)
        for path in (folder, *folder.iterdir()):
            shutil.chown(path, name)
    run = f"{sys.executable} -m traverse"
    watch = next(line for line in commands(SECURE) if "traverse watch" in line)
    watch = as_run(watch, port).replace(f"--broker {HOST}", f"--broker mqtts://{HOST}")
    point = watch.replace("traverse watch", "traverse point")
    with (
        Shell(
            home, "board", _as_user(DAEMON, f"{run} simulate devices simulator.toml")
        ),
        Shell(home, "arm", _as_user(DAEMON, f"{run} run daemon.toml")) as arm,
        Shell(person, "watch", _as_user(PERSON, watch)) as display,
    ):
        await display.says("ready")
        assert _user_of(arm.process.pid) == DAEMON
        with Shell(person, "point", _as_user(PERSON, point)) as session:
            printed = await session.ends()
        assert "mm" in printed
        await display.says(" point ")
    with Shell(person, "secret", _as_user(PERSON, f"cat {home}/broker.password")) as no:
        await until(lambda: no.process.poll() is not None, "an end")
        assert "Permission denied" in no.output
