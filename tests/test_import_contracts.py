import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.running import run_program

CHECKOUT = Path(__file__).parents[1]
CONFIGURATION = tomllib.loads((CHECKOUT / "pyproject.toml").read_text("utf-8"))
CONTRACTS = CONFIGURATION["tool"]["importlinter"]["contracts"]
ROOT = CHECKOUT / "src" / "traverse"
PACKAGES = sorted(initial.parent.name for initial in ROOT.glob("*/__init__.py"))


def lint_imports(folder: Path, status: int = 0) -> subprocess.CompletedProcess[str]:
    program = Path(sys.executable).parent / "lint-imports"
    return run_program(
        program,
        "--no-cache",
        cwd=folder,
        env={**os.environ, "COLUMNS": "200"},
        status=status,
    )


def copy(folder: Path) -> Path:
    """The packages and their contracts in a folder where mischief is allowed."""
    shutil.copytree(
        ROOT,
        folder / "traverse",
        ignore=lambda _, names: [
            n for n in names if "." in n and not n.endswith(".py")
        ],
    )
    shutil.copy(CHECKOUT / "pyproject.toml", folder)
    return folder


def test_all_arrows_hold() -> None:
    lint_imports(CHECKOUT)


def test_the_untouched_copy_passes(tmp_path: Path) -> None:
    lint_imports(copy(tmp_path))


PLANTED = {
    "each layer of the house": [
        ("drivers/base/driver.py", "traverse.cli.common.message_lines"),
        ("broker/reasons.py", "traverse.__main__"),
        ("daemon/clock.py", "traverse.simulator.pacing"),
        ("daemon/pose/live.py", "traverse.client.mqtt.subscription"),
        ("daemon/pose/poses.py", "traverse"),  # whose `Arm` is the client's
        ("daemon/pose/joint_motion.py", "traverse.lab.campaign.campaign"),
        ("client/mqtt/subscription.py", "traverse.daemon.clock"),
        ("client/points/cursor.py", "traverse.simulator.pacing"),
        ("client/change_signal.py", "traverse.lab.campaign.campaign"),
        ("lab/planted.py", "traverse.simulator.arm.physics"),
        ("lab/campaign/campaign.py", "traverse.daemon.clock"),
        ("lab/campaign/campaign_file.py", "traverse.client.points.cursor"),
        ("simulator/effects/planted.py", "traverse.lab.diagnosis"),
        ("simulator/devices/latch_board/wire.py", "traverse.daemon.clock"),
        ("simulator/arm/physics.py", "traverse.client.points.cursor"),
        ("drivers/timing/device_clock.py", "traverse.daemon.clock"),
        ("recording/planted.py", "traverse.drivers.base.values"),
        ("recording/maps.py", "traverse.broker.reasons"),
        ("broker/client.py", "traverse.recording.maps"),
        ("broker/credentials.py", "traverse.drivers.base.values"),
        ("protocol/latch_board/framing.py", "traverse.kinematics.model.geometry"),
        ("protocol/topics.py", "traverse.recording.maps"),
        ("kinematics/model/geometry.py", "traverse.protocol.latch_board.framing"),
        ("kinematics/model/readings.py", "traverse.lab.campaign.campaign"),
    ],
    "ports belong to": [
        ("simulator/devices/latch_board/wire.py", "traverse.drivers.base.values"),
        ("lab/planted.py", "traverse.drivers.base.values"),
        ("client/planted.py", "traverse.drivers.base.values"),
    ],
    "only what speaks MQTT": [
        ("drivers/base/driver.py", "traverse.broker.reasons"),
        ("simulator/devices/latch_board/wire.py", "traverse.broker.reasons"),
        ("lab/planted.py", "traverse.broker.reasons"),
    ],
    "drivers know bytes, ports": [
        ("drivers/timing/device_clock.py", "traverse.kinematics.model.forward"),
        ("drivers/base/driver.py", "traverse.recording.reader"),
        ("drivers/base/driver.py", "traverse.recording.values"),
    ],
    "the simulator shares no code": [
        ("simulator/devices/latch_board/wire.py", "traverse.protocol.latch_board"),
        ("simulator/arm/physics.py", "traverse.kinematics.model.forward"),
        ("simulator/effects/planted.py", "traverse.kinematics.effects"),
        ("simulator/pacing.py", "traverse.recording.reader"),
    ],
    "the simulator does not read": [
        ("simulator/arm/physics.py", "traverse.kinematics.effect_table")
    ],
    "folders of kinematics": [
        ("kinematics/arm_file/arm.py", "traverse.kinematics.model.forward"),
        ("kinematics/effect_table.py", "traverse.kinematics.effects"),
        ("kinematics/kernel/terms.py", "traverse.kinematics.model.geometry"),
    ],
    "folders of the effects": [
        (
            "kinematics/effects/base/contact.py",
            "traverse.kinematics.effects.mechanics.motions",
        ),
        (
            "kinematics/effects/readings/planted.py",
            "traverse.kinematics.effects.contacts.touching",
        ),
    ],
    "only readers of files in kinematics": [
        ("kinematics/model/forward.py", "pydantic"),
        ("kinematics/effects/planted.py", "tomlkit"),
    ],
    "getting in at a broker": [
        ("broker/reasons.py", "traverse.protocol.topics"),
        ("broker/credentials.py", "traverse.kinematics.model.geometry"),
    ],
    "folders of the lab": [
        ("lab/identification/planted.py", "traverse.lab.diagnosis.diagnose"),
        ("lab/acceptance/planted.py", "traverse.lab.diagnosis.diagnose"),
        ("lab/artefacts/planted.py", "traverse.lab.campaign.campaign"),
    ],
    "modules of the adjustment": [
        ("lab/adjustment/equations.py", "traverse.lab.adjustment.system"),
        ("lab/adjustment/noise.py", "traverse.lab.adjustment.parameters"),
    ],
    "the adjustment is used": [
        ("lab/diagnosis/model/planted.py", "traverse.lab.adjustment.solve"),
        ("lab/identification/solution.py", "traverse.lab.adjustment.system"),
    ],
    "the diagnosis needs no": [
        ("lab/diagnosis/model/planted.py", "traverse.lab.identification.results.result")
    ],
    "folders of the diagnosis": [
        ("lab/diagnosis/model/planted.py", "traverse.lab.diagnosis.diagnose")
    ],
    "folders of the identification": [
        (
            "lab/identification/certificates.py",
            "traverse.lab.identification.results.files",
        )
    ],
    "folders of the daemon": [
        ("daemon/pose/pipeline.py", "traverse.daemon.acquisition.interpolation"),
        ("daemon/pose/quality_monitor.py", "traverse.daemon.points.capture"),
        ("daemon/scans/plan.py", "traverse.daemon.commands.dispatcher"),
        ("daemon/store/durable_queue.py", "traverse.daemon.commands.dispatcher"),
        ("daemon/store/records.py", "traverse.daemon.points.capture"),
        ("daemon/store/outbox.py", "traverse.daemon.points.capture"),
        ("daemon/mqtt/sender.py", "traverse.daemon.store.outbox"),
        ("daemon/pose/planted.py", "traverse.daemon.store.records"),
        ("daemon/points/planted.py", "traverse.daemon.scans.scanner"),
        ("daemon/monitoring/planted.py", "traverse.daemon.mqtt.sender"),
        ("daemon/config/planted.py", "traverse.daemon.clock"),
        ("daemon/recorder/planted.py", "traverse.daemon.service"),
    ],
    "families of drivers": [
        ("drivers/rls/planted.py", "traverse.drivers.amt21.driver"),
        ("drivers/io/planted.py", "traverse.drivers.polling.channel"),
    ],
    "folders of the simulator": [
        ("simulator/arm/planted.py", "traverse.simulator.scenario.script"),
        ("simulator/scenario/planted.py", "traverse.simulator.devices.device"),
    ],
    "strict files are read": [
        ("strict_toml/planted.py", "traverse.kinematics.model.geometry"),
        ("strict_toml/problems.py", "traverse.protocol.topics"),
    ],
    "one module of strict files": [
        ("strict_toml/problems.py", "pydantic"),
        ("strict_toml/reader.py", "tomlkit"),
    ],
    "protocol is bytes and values only": [
        ("protocol/latch_board/framing.py", "time"),
        ("protocol/encoding.py", "logging"),
    ],
    "kinematics is mathematics only": [("kinematics/model/forward.py", "asyncio")],
    "scipy stays in the lab": [
        ("kinematics/model/geometry.py", "scipy"),
        ("cli/common/message_lines.py", "matplotlib"),
    ],
}
UNKNOWN = [
    ("planted.py", "each layer"),
    ("kinematics/planted.py", "folders of kinematics"),
    ("lab/planted.py", "folders of the lab"),
    ("simulator/planted.py", "folders of the simulator"),
    ("daemon/planted.py", "folders of the daemon"),
]


def sections(checked: subprocess.CompletedProcess[str]) -> dict[str, str]:
    _, _, report = checked.stdout.partition("Broken contracts")
    headed = re.split(r"^(.+)\n-+\n", report, flags=re.MULTILINE)
    return dict(zip(headed[1::2], headed[2::2], strict=True))


def section(reports: dict[str, str], contract: str) -> str:
    (report,) = (text for name, text in reports.items() if name.startswith(contract))
    return report


@pytest.fixture(scope="module")
def planted_imports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """All forbidden imports at once: the message on every contract."""
    folder = copy(tmp_path_factory.mktemp("imports"))
    for module, planted in {
        planted_one for many in PLANTED.values() for planted_one in many
    }:
        with (folder / "traverse" / module).open("a", encoding="utf-8") as source:
            source.write(f"\nimport {planted}\n")
    return sections(lint_imports(folder, status=1))


@pytest.mark.parametrize("contract", PLANTED)
def test_planted_imports_are_caught(
    planted_imports: dict[str, str], contract: str
) -> None:
    report = section(planted_imports, contract)
    for module, planted in PLANTED[contract]:
        name = f"traverse/{module.removesuffix('.py')}".replace("/", ".")
        assert f"{name} -> {planted} " in report


@pytest.fixture(scope="module")
def planted_modules(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """All modules without a layer at once: the message on every contract."""
    folder = copy(tmp_path_factory.mktemp("modules"))
    for module, _ in UNKNOWN:
        (folder / "traverse" / module).write_text('"""Planted."""\n', "utf-8")
    return sections(lint_imports(folder, status=1))


@pytest.mark.parametrize(("module", "contract"), UNKNOWN)
def test_a_module_that_has_no_layer_is_caught(
    planted_modules: dict[str, str], module: str, contract: str
) -> None:
    name = f"traverse.{module.removesuffix('.py')}".replace("/", ".")
    assert name in section(planted_modules, contract)


def test_only_what_speaks_mqtt_may_use_the_way_in_at_a_broker() -> None:
    (layers,) = (c["layers"] for c in CONTRACTS if c.get("containers") == ["traverse"])
    (place,) = (n for n, layer in enumerate(layers) if "broker" in layer.split(" | "))
    above = {name for layer in layers[:place] for name in layer.split(" | ")}
    kept_out = {
        module.removeprefix("traverse.")
        for contract in CONTRACTS
        if "traverse.broker" in contract.get("forbidden_modules", ())
        for module in contract["source_modules"]
    }
    assert above - kept_out == {"__main__", "cli", "fleet", "daemon", "client"}


def test_every_package_has_a_layer() -> None:
    (layers,) = (c["layers"] for c in CONTRACTS if c.get("containers") == ["traverse"])
    named = [name for layer in layers for name in layer.split(" | ")]
    modules = ["__main__", "arrays", "extensions", "installation", "plurals"]
    assert sorted(named) == sorted([*modules, *PACKAGES])


def test_every_contract_has_a_violation_that_is_planted_here() -> None:
    contracts = [contract["name"] for contract in CONTRACTS]
    unproven = [n for n in contracts if not any(n.startswith(p) for p in PLANTED)]
    assert not unproven
