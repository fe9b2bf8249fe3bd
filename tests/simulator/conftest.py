from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.arm_files import arm_text, joint_text
from traverse.simulator.arm.physics import Mechanism
from traverse.simulator.config import SimulatorConfig, config_problems
from traverse.simulator.scenario.script import Script
from traverse.simulator.virtual_arm import VirtualArm, build_arm, build_script
from traverse.strict_toml.reader import parse_strict

AXES = ([0, 0, 1], [0, 1, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [0, 1, 0], [0, 0, -1])
LINKS_MM = (
    *([0, 0, 250], [60, 0, 0], [400, 0, 0], [50, 0, 0]),
    *([330, 0, 0], [0, 0, -50], [0, 0, -110]),
)


def seven_text(kind: str = "hard") -> str:
    joints = (
        joint_text(
            *(f"J{number + 1}", axis, link_mm, 0.3 * number),
            (8388608, (-1) ** number, f"base/{number}"),
        )
        for number, (axis, link_mm) in enumerate(zip(AXES, LINKS_MM, strict=True))
    )
    return arm_text("seven", *joints, probe=f'radius_mm = 3.0\nkind = "{kind}"')


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
    (tmp_path / "arm.toml").write_text(seven_text())
    return tmp_path


@pytest.fixture
def stage(folder: Path) -> Callable[..., tuple[VirtualArm, Script]]:
    """Play motions with the arm; return the arm and its script."""

    def play(motions: str, head: str = "", kind: str = "hard"):
        (folder / "arm.toml").write_text(seven_text(kind))
        text = config_text(motions, head)
        config = parse_strict(text, "sim.toml", SimulatorConfig, config_problems)
        arm = build_arm(config, folder, "sim.toml")
        return arm, build_script(config, arm, folder, "sim.toml")

    return play


@pytest.fixture
def seven() -> Mechanism:
    rng = np.random.default_rng(5)
    axes = np.array(AXES, dtype=float)
    axes += 0.05 * rng.standard_normal(axes.shape)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    ends = np.cumsum(np.array(LINKS_MM, dtype=float), axis=0)
    origins = np.vstack([np.zeros(3), ends[:-1]])
    return Mechanism(origins, axes, ends[-1], np.array([0.0, 0.0, -1.0]))
