import sys
from importlib.metadata import version

import pytest

from tests.running import invoke, run_program
from traverse.kinematics.model.kernel_choice import KERNEL

COMMANDS = ("demo", "run", "simulate", "watch", "check")


def output_of(*arguments: str) -> tuple[int, str]:
    """Exit status and words, line breaks and frames of the terminal left out."""
    result = invoke(*arguments, env={"COLUMNS": "300"}, status=None)
    return result.exit_code, " ".join(result.output.replace("│", " ").split())


def test_version_says_which_kernel_computes() -> None:
    status, text = output_of("--version")
    assert status == 0
    assert text == f"traverse {version('traverse-cmm')} (kernel: {KERNEL})"


def test_the_module_is_the_command() -> None:
    run = run_program(sys.executable, "-m", "traverse", "--version")
    assert run.stderr == ""
    assert run.stdout.startswith("traverse ")


def test_help_names_every_command() -> None:
    status, text = output_of("--help")
    assert status == 0
    assert all(f" {command} " in text for command in COMMANDS)


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("demo", ("Exit status 3", "--for", "seconds", "--rate", "in Hz", "Ctrl-C")),
        ("run", ("Exit status 2", "3: a device or the broker", "SIGTERM", "TOML")),
        ("simulate devices", ("Exit status 2", "SIGTERM", "TOML", "ready")),
        ("watch", ("Exit status 3", "--json", "Ctrl-C")),
        ("check", ("Exit status 2", "--json")),
    ],
)
def test_help_lists_units_and_exit_statuses(
    command: str, words: tuple[str, ...]
) -> None:
    for option in ("--help", "-h"):
        status, text = output_of(*command.split(), option)
        assert status == 0
        assert [word for word in words if word not in text] == []


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("nonsense",),
        ("run",),
        ("simulate",),
        ("check",),
        ("run", "--config"),
        ("simulate", "devices"),
        ("demo", "--for", "0"),
        ("demo", "--rate", "10001"),
        ("watch", "--broker", "localhost:70000"),
        ("watch", "--kinds", ","),
    ],
)
def test_misuse_is_refused_with_status_2(arguments: tuple[str, ...]) -> None:
    assert output_of(*arguments)[0] == 2
