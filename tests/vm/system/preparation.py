"""Files of an arm on vcan0: as an administrator writes them, from the examples.

Three simulated encoders, because the processor is emulated, and a pedal that takes
points.
"""

import os
import re
import shutil
import subprocess
from pathlib import Path

from tests.vm.system.pedal import PORT, RULE, RULES
from tests.vm.system.unit import ARM, NAME

EXAMPLES = Path("/usr/share/doc/traverse/examples")
FOLDER = Path("/etc/traverse") / ARM
SIMULATED = Path("/srv/arm")
MOSQUITTO = Path("/etc/mosquitto")
OPERATOR = f"{ARM}-operator"  # of the example of rights
PASSWORDS = {ARM: "correct-horse-7", OPERATOR: "battery-staple"}
TRACKING_HZ = 10.0  # what an emulated processor can do
N_JOINTS = 3

_DAEMON = f"""\
answer_s = 5.0
late_s = 1.0

[[device]]
id = "pedal"
driver = "evdev"
port = "{PORT}"
keys = ["KEY_B"]

[capture]
tracking_rate_hz = {TRACKING_HZ}
live_rate_hz = 1.0
inputs = [{{ source = "pedal/0", trigger = "button" }}]

[assembly]
wait_s = 1.0
point_wait_s = 5.0

[recording]
flight = false
"""
# An emulated processor on a busy computer: what takes a second takes half a minute.
_SLOW = """\
[Service]
WatchdogSec=30
TimeoutStartSec=300
"""
_SIMULATOR_UNIT = f"""\
[Unit]
After=sys-subsystem-net-devices-vcan0.device
Wants=sys-subsystem-net-devices-vcan0.device

[Service]
DynamicUser=yes
WorkingDirectory={SIMULATED}
ExecStart=/usr/bin/traverse simulate devices simulator.toml

[Install]
WantedBy=multi-user.target
"""


def write_daemon() -> None:
    """Configuration, arm file and password of the daemon."""
    FOLDER.mkdir()
    text = (EXAMPLES / "traverse.toml").read_text("utf-8")
    text = (
        with_few_nodes(text).replace("can0", "vcan0").replace("#username", "username")
    )
    text = text.replace("#password_file", "password_file") + _DAEMON
    (FOLDER / "traverse.toml").write_text(text, "utf-8")
    write_arm(FOLDER)
    secret = FOLDER / "broker.password"
    secret.touch(mode=0o600)
    secret.write_text(PASSWORDS[ARM] + "\n", "utf-8")


def write_drop_in() -> None:
    folder = Path(f"/etc/systemd/system/{NAME}.d")
    folder.mkdir()
    (folder / "slow.conf").write_text(_SLOW, "utf-8")


def write_arm(folder: Path) -> None:
    """The arm file of the examples: the first joints, and this arm's name."""
    text = (EXAMPLES / "arm.toml").read_text("utf-8")
    head, *joints = text.replace("demo-7", ARM).split("[[joints]]")
    tail = joints[-1][joints[-1].index("[probe]") :]
    text = "[[joints]]".join([head, *joints[:N_JOINTS]]) + tail
    (folder / "arm.toml").write_text(text, "utf-8")


def with_few_nodes(text: str) -> str:
    return re.sub(r"(?m)^nodes = .*$", f"nodes = {[*range(11, 11 + N_JOINTS)]}", text)


def write_simulator() -> None:
    SIMULATED.mkdir(parents=True)
    text = (EXAMPLES / "simulator.toml").read_text("utf-8")
    (SIMULATED / "simulator.toml").write_text(with_few_nodes(text), "utf-8")
    write_arm(SIMULATED)
    Path("/etc/systemd/system/arm-simulator.service").write_text(_SIMULATOR_UNIT)


def write_broker() -> None:
    shutil.copy(EXAMPLES / "mosquitto/traverse.conf", MOSQUITTO / "conf.d")
    passwords = MOSQUITTO / "traverse.passwords"
    passwords.write_text("".join(f"{n}:{word}\n" for n, word in PASSWORDS.items()))
    subprocess.run(["mosquitto_passwd", "-U", str(passwords)], check=True)
    acl = MOSQUITTO / "traverse.acl"
    shutil.copy(EXAMPLES / "mosquitto/acl", acl)
    for path in (passwords, acl):
        shutil.chown(path, "root", "mosquitto")
        path.chmod(0o640)


if __name__ == "__main__":
    os.umask(0o022)
    write_daemon()
    write_drop_in()
    write_simulator()
    write_broker()
    Path(RULES).write_text(RULE, "utf-8")
    subprocess.run(["udevadm", "control", "--reload"], check=True)
    subprocess.run(["systemctl", "daemon-reload"], check=True)
