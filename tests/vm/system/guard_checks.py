"""The daemon's identity, and its restrictions."""

import re
import subprocess
from pathlib import Path

from tests.vm.system import unit
from tests.vm.system.preparation import FOLDER, PASSWORDS

MOST_EXPOSURE = 2.0


def be_nobody() -> str:
    """No process of the unit is root's or has a capability."""
    users = [unit.status_of(process) for process in unit.processes()]
    assert users, "no process"
    for status in users:
        assert set(status["Uid"].split()) != {"0"}, status["Name"]
        assert "0" not in status["Uid"].split(), status["Name"]
        sets = {status[name] for name in ("CapPrm", "CapEff", "CapBnd", "CapAmb")}
        assert sets == {"0" * 16}, sets
        assert status["NoNewPrivs"] == "1"
        assert status["Seccomp"] == "2"
    user = unit.run("ps", "-o", "user=", "-p", str(unit.main_pid()))
    return f"{len(users)} process of {user}, no capability, seccomp"


def be_shut(name: str = unit.NAME) -> str:
    output = unit.run("systemd-analyze", "security", "--no-pager", name)
    figure = re.search(r"exposure level for .*?: ([\d.]+)", output)
    assert figure is not None, output
    assert float(figure[1]) <= MOST_EXPOSURE, figure[0]
    return f"{figure[1]} (at most {MOST_EXPOSURE})"


def stay_inside() -> str:
    """In the daemon's own view of the files: where it can write, and devices."""
    places = ["/etc/traverse", "/usr", "/var/lib", "/srv", "/home", "/root"]
    root = Path(f"/proc/{unit.main_pid()}/root")
    words = ["nsenter", "--mount", "--target", str(unit.main_pid())]
    script = "for p; do touch $p/probe 2>/dev/null && echo $p; done; true"
    can = unit.run(*words, "sh", "-c", script, "sh", *places, f"{STATE}")
    assert can.split() == [STATE], f"root in the daemon's place writes to {can}"
    (root / STATE.lstrip("/") / "probe").unlink()
    mode = (FOLDER / "broker.password").stat().st_mode & 0o777
    assert mode == 0o600, oct(mode)
    return f"writes to {STATE} alone, of {len(places) + 1} places"


def reach_devices() -> str:
    """A serial adapter on USB by its name that stays, and no disk."""
    links = sorted(Path("/dev/traverse").glob("serial-*"))
    assert len(links) == 1, f"names of serial adapters: {links}"
    port = links[0].resolve()
    assert port.group() == "dialout"
    timer = Path(f"/sys/class/tty/{port.name}/device/latency_timer").read_text().strip()
    assert timer == "1", f"latency timer {timer} ms"
    group = Path("/sys/fs/cgroup") / unit.shown("ControlGroup").lstrip("/")
    script = f"echo $$ > {group}/cgroup.procs; exec 3<$0"
    for path, may in ((links[0], True), (Path("/dev/vda"), False)):
        ran = subprocess.run(
            ["sh", "-c", script, path], capture_output=True, text=True, check=False
        )
        assert (ran.returncode == 0) == may, f"{path}: {ran.returncode} {ran.stderr}"
    return f"{links[0].name} is {port}, latency timer 1 ms; /dev/vda is refused"


def keep_secret() -> str:
    """The password: not in the journal, the command line or the environment."""
    password = PASSWORDS["bench-7"]
    process = Path("/proc") / str(unit.main_pid())
    for name in ("cmdline", "environ"):
        assert password.encode() not in (process / name).read_bytes(), name
    assert password not in unit.journal(), "journal"
    matches = subprocess.run(
        ["grep", "-rl", password, "/var/lib/traverse", "/run/systemd/journal"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert not matches.stdout, matches.stdout
    return "not in journal, command line, environment, state; handed over by systemd"


STATE = "/var/lib/traverse/bench-7"
