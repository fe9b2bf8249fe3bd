"""An arm of seven joints and configurations around it."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from traverse.simulator.arm.physics import Mechanism
from traverse.simulator.config import SimulatorConfig, config_problems
from traverse.simulator.scenario.script import Script
from traverse.simulator.virtual_arm import VirtualArm, build_arm, build_script
from traverse.strict_toml.reader import parse_strict

AXES = ["0, 0, 1", "0, 1, 0", "1, 0, 0", "0, 1, 0", "1, 0, 0", "0, 1, 0", "0, 0, -1"]
LINKS = ["0, 0, 250", "60, 0, 0", "400, 0, 0", "50, 0, 0", "330, 0, 0", "0, 0, -50"]
LINKS += ["0, 0, -110"]


def arm_text(kind: str = "hard") -> str:
    text = 'schema = "traverse/arm/1"\nname = "seven"\norigin_mm = [0, 0, 0]\n'
    for number, (axis, link) in enumerate(zip(AXES, LINKS, strict=True)):
        text += f"""
[[joints]]
name = "J{number + 1}"
axis = [{axis}]
link_mm = [{link}]
zero_rad = {0.3 * number}
[joints.encoder]
counts_per_turn = 8388608
sign = {(-1) ** number}
source = "base/{number}"
"""
    return (
        text
        + f"""
[probe]
radius_mm = 3.0
kind = "{kind}"
[reference]
temperature_c = 20.0
gravity_m_s2 = [0.0, 0.0, -9.80665]
"""
    )


def config_text(motions: str, head: str = "", faults: str = "") -> str:
    return f"""
schema = "traverse/simulator/1"
seed = 11
{head}
[arm]
file = "arm.toml"
deviations = {{ links_mm = 0.2, axes_rad = 1e-3, zeros_rad = 1e-3 }}
[operator]
move_s = 0.2
approach_s = 0.1
dwell_s = 0.05
press_s = 0.05
[[device]]
id = "base"
port = "port/base"
{motions}
{faults}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "arm.toml").write_text(arm_text())
    return tmp_path


@pytest.fixture
def stage(folder: Path) -> Callable[..., tuple[VirtualArm, Script]]:
    """Play motions with the arm; return the arm and its script."""

    def play(motions: str, head: str = "", kind: str = "hard"):
        (folder / "arm.toml").write_text(arm_text(kind))
        text = config_text(motions, head)
        config = parse_strict(text, "sim.toml", SimulatorConfig, config_problems)
        arm = build_arm(config, folder, "sim.toml")
        return arm, build_script(config, arm, folder, "sim.toml")

    return play


@pytest.fixture
def seven() -> Mechanism:
    rng = np.random.default_rng(5)
    axes = np.array([[float(c) for c in axis.split(",")] for axis in AXES])
    axes += 0.05 * rng.standard_normal(axes.shape)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    ends = np.cumsum([[float(c) for c in link.split(",")] for link in LINKS], axis=0)
    origins = np.vstack([np.zeros(3), ends[:-1]])
    return Mechanism(origins, axes, ends[-1], np.array([0.0, 0.0, -1.0]))
