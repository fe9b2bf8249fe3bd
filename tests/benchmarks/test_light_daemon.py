import sys

from tests.running import run_program

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
    run = run_program(sys.executable, "-c", program)
    assert run.stdout.split() == []
