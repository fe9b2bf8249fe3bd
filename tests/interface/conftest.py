"""Fixtures of the tests of the published interface."""

import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ROOT / "build" / "node" / "node_modules"


@pytest.fixture
def node_modules() -> Path:
    """Packages of npm, as `make build/node/.ready` has put them there."""
    if shutil.which("node") is None or not PACKAGES.is_dir():
        pytest.skip("needs node, and `make node` once")
    return PACKAGES


@pytest.fixture
def readers(node_modules: Path, tmp_path: Path) -> Path:
    """A folder with the readers of the documentation and what they import."""
    folder = tmp_path / "readers"
    shutil.copytree(ROOT / "docs" / "integrations", folder)
    (folder / "node_modules").symlink_to(node_modules)
    return folder
