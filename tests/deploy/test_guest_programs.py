"""The programs in the guest of `make test-vm` need nothing but the package."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

from tests.docs.pages import CHECKOUT

PACKAGED = ("broker", "client", "daemon", "drivers", "kinematics", "protocol")
BY_PYTHON = sys.stdlib_module_names | {"tests", "traverse"}


def imported(path: Path) -> set[str]:
    names = set()
    for node in ast.parse(path.read_text("utf-8")).body:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            names.add(node.module)
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def files_of(module: str) -> Iterator[Path]:
    """Files of a module of this project, and of the packages around it."""
    parts = module.split(".")
    if parts[0] not in ("tests", "traverse"):
        return
    names = parts[parts[0] == "traverse" :]
    for n in range(1, len(names) + 1):
        path = CHECKOUT.joinpath(*names[:n])
        files = path.with_suffix(".py"), path / "__init__.py"
        yield from (file for file in files if file.exists())


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
            new = set(files_of(module)) - seen
            seen |= new
            waiting += new
            if module.partition(".")[0] not in of_package | BY_PYTHON:
                foreign.add((path.name, module))
    assert len(seen) > 12
    assert foreign == set()
