import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ROOT / "build" / "node" / "node_modules"


@pytest.fixture
def node_modules(pytestconfig: pytest.Config) -> Path:
    if not PACKAGES.is_dir():
        required = "node" in pytestconfig.getoption("--required").split()
        (pytest.fail if required else pytest.skip)("needs `make node` once")
    return PACKAGES


@pytest.fixture
def readers(node_modules: Path, tmp_path: Path) -> Path:
    folder = tmp_path / "readers"
    shutil.copytree(ROOT / "docs" / "integrations", folder)
    (folder / "node_modules").symlink_to(node_modules)
    return folder
