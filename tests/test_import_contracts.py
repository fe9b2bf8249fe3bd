"""The arrows of the design are checked by import-linter; a planted violation fails."""

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[1]
CONFIGURATION = tomllib.loads((CHECKOUT / "pyproject.toml").read_text("utf-8"))
PACKAGES = CONFIGURATION["tool"]["importlinter"]["root_packages"]


def lint_imports(folder: Path) -> subprocess.CompletedProcess[str]:
    """Check the contracts of the packages in a folder."""
    program = Path(sys.executable).parent / "lint-imports"
    return subprocess.run(
        [program, "--no-cache"],
        cwd=folder,
        env={**os.environ, "COLUMNS": "200"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """The packages and their contracts in a folder where mischief is allowed."""
    for package in PACKAGES:
        shutil.copytree(
            CHECKOUT / package,
            tmp_path / package,
            ignore=lambda _, names: [
                n for n in names if "." in n and not n.endswith(".py")
            ],
        )
    shutil.copy(CHECKOUT / "pyproject.toml", tmp_path)
    return tmp_path


def test_all_arrows_hold() -> None:
    checked = lint_imports(CHECKOUT)
    assert checked.returncode == 0, checked.stdout


def test_the_untouched_copy_passes(copied: Path) -> None:
    checked = lint_imports(copied)
    assert checked.returncode == 0, checked.stdout


@pytest.mark.parametrize(
    ("module", "planted", "contract"),
    [
        ("daemon/clock.py", "simulator.clock", "the daemon knows neither"),
        ("daemon/live.py", "clients.subscription", "the daemon knows neither"),
        ("drivers/tick_clock.py", "kinematics.forward", "drivers know bytes, ports"),
        ("simulator/wire.py", "protocol.latch_board", "the simulator shares no code"),
        ("simulator/physics.py", "kinematics.forward", "the simulator shares no code"),
        (
            "simulator/effects/planted.py",
            "lab.diagnosis",
            "the generator of blind tests",
        ),
        ("protocol/framing.py", "time", "protocol is bytes and values only"),
        ("protocol/encoding.py", "logging", "protocol is bytes and values only"),
        ("kinematics/forward.py", "asyncio", "kinematics is mathematics only"),
        ("kinematics/forward.py", "pydantic", "only the arm-file reader"),
        ("clients/subscription.py", "daemon.clock", "clients connect from outside"),
        ("broker/reasons.py", "protocol.topics", "getting in at a broker"),
        ("recording/planted.py", "drivers.values", "recording is files"),
        ("lab/planted.py", "simulator.physics", "the lab is off-line"),
        (
            "lab/identification/planted.py",
            "lab.diagnosis",
            "identification is below diagnosis",
        ),
        (
            "lab/acceptance/planted.py",
            "lab.diagnosis",
            "identification is below diagnosis",
        ),
        ("kinematics/geometry.py", "scipy", "scipy stays in the lab"),
        ("drivers/driver.py", "traverse.lines", "nobody imports the command line"),
    ],
)
def test_a_planted_import_is_caught(
    copied: Path, module: str, planted: str, contract: str
) -> None:
    with (copied / module).open("a", encoding="utf-8") as source:
        source.write(f"\nimport {planted}\n")
    checked = lint_imports(copied)
    broken = [line for line in checked.stdout.splitlines() if line.endswith(" BROKEN")]
    assert checked.returncode == 1, checked.stdout
    assert any(line.startswith(contract) for line in broken), checked.stdout


def test_only_what_speaks_mqtt_may_use_the_way_in_at_a_broker() -> None:
    contracts = CONFIGURATION["tool"]["importlinter"]["contracts"]
    kept_out = {
        module
        for contract in contracts
        if "broker" in contract.get("forbidden_modules", ())
        for module in contract["source_modules"]
    }
    assert set(PACKAGES) - kept_out == {"traverse", "daemon", "clients", "broker"}


def test_every_contract_has_a_violation_that_is_planted_here() -> None:
    contracts = [c["name"] for c in CONFIGURATION["tool"]["importlinter"]["contracts"]]
    mark = test_a_planted_import_is_caught.pytestmark[0]  # type: ignore[attr-defined]  # pytest puts it there
    planted = {contract for _, _, contract in mark.args[1]}
    unproven = [n for n in contracts if not any(n.startswith(p) for p in planted)]
    assert not unproven
