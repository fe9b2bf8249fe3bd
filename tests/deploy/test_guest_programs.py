"""What the guest of `make test-vm` runs needs nothing but the package."""

import ast
import sys
from pathlib import Path

from tests.docs.pages import CHECKOUT

PACKAGED = ("broker", "client", "daemon", "drivers", "kinematics", "protocol")
BY_PYTHON = sys.stdlib_module_names | {"tests", "traverse"}


def imported(path: Path) -> set[str]:
    """Modules that a file imports when it is imported itself."""
    names = set()
    for node in ast.parse(path.read_text("utf-8")).body:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            names.add(node.module)
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def file_of(module: str) -> Path | None:
    path = CHECKOUT.joinpath(*module.split("."))
    files = path.with_suffix(".py"), path / "__init__.py"
    return next((file for file in files if file.exists()), None)


def test_the_guest_s_programs_import_what_the_package_has():
    of_package = {
        name.partition(".")[0]
        for folder in PACKAGED
        for path in (CHECKOUT / folder).rglob("*.py")
        for name in imported(path)
    }
    waiting = list((CHECKOUT / "tests" / "vm" / "system").glob("*.py"))
    seen, foreign = set(waiting), set()
    while waiting:
        path = waiting.pop()
        for module in imported(path):
            file = file_of(module) if module.startswith("tests.") else None
            if file is not None and file not in seen:
                seen.add(file)
                waiting.append(file)
            if module.partition(".")[0] not in of_package | BY_PYTHON:
                foreign.add((path.name, module))
    assert len(seen) > 12
    assert foreign == set()
