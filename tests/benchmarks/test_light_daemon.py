"""What a daemon imports: nothing that only other commands need."""

import subprocess
import sys

HEAVY = (
    "scipy",
    "matplotlib",
    "amqtt",
    "nicegui",
    "can",
    "rich",
    "tomlkit",
    "traverse.cli.demo",
    "traverse.kinematics.effects.readings.rates",
    "traverse.lab",
    "traverse.simulator",
)


def test_daemon_imports_nothing_heavy():
    program = (
        "import sys, traverse.daemon.app, traverse.cli.__main__ as cli\n"
        "cli.command_line(['run'])\n"
        f"print(*(name for name in {HEAVY!r} if name in sys.modules))"
    )
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert run.stdout.split() == []
