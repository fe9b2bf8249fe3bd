"""What a daemon imports: nothing that only other commands need."""

import subprocess
import sys

HEAVY = (
    "scipy",
    "matplotlib",
    "amqtt",
    "nicegui",
    "can",
    "traverse.lab",
    "traverse.simulator",
)


def test_daemon_imports_nothing_heavy():
    program = (
        "import sys, traverse.cli.__main__, traverse.daemon.app\n"
        f"print(*(name for name in {HEAVY!r} if name in sys.modules))"
    )
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert run.stdout.split() == []
