"""What is installed is what stands in the checkout."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent
NOT_INSTALLED = {"tests", "benchmarks", "build"}


def project() -> dict:
    return tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))


def packages_of_the_checkout() -> set[str]:
    found = set()
    for initial in ROOT.glob("[a-z]*/**/__init__.py"):
        parts = initial.parent.relative_to(ROOT).parts
        if parts[0] not in NOT_INSTALLED:
            found.add(".".join(parts))
    return found


def test_every_package_is_listed():
    listed = project()["tool"]["setuptools"]["packages"]
    assert set(listed) == packages_of_the_checkout()


def test_the_simulator_is_kept_from_every_module_of_kinematics_but_the_reader():
    reader = {"arm_file", "arm_checks", "arm_text", "__init__"}
    reader |= {"effect_checks", "effect_kinds", "file_problems", "model_problems"}
    reader |= {"raw_values"}
    modules = {path.stem for path in (ROOT / "kinematics").glob("*.py")} - reader
    contracts = project()["tool"]["importlinter"]["contracts"]
    (contract,) = (c for c in contracts if c["name"].startswith("the simulator"))
    assert {f"kinematics.{name}" for name in modules} <= set(
        contract["forbidden_modules"]
    )
