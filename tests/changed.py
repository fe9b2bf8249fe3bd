"""Run the quick tests of what has changed: `make check`.

Changed is what differs from the main branch, committed or not. Selected are test files
that changed, those named like a changed module, those that name a changed file of
another kind, and those that import a changed module, nearest first and at most
`MOST_FILES`. It prints the tests that it leaves out; `make test` runs them.
"""

import ast
import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

MAIN = ("origin/main", "main", "HEAD")
DEPTH = 3  # imports from a test file to a changed module
MOST_FILES = 15


def _git(root: Path, *arguments: str) -> list[str]:
    command = ["git", "-C", str(root), *arguments]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    return ran.stdout.splitlines() if ran.returncode == 0 else []


def changed_files(root: Path) -> set[str]:
    """Files that differ from where the branch left main, and new ones."""
    base = next(
        bases[0] for name in MAIN if (bases := _git(root, "merge-base", name, "HEAD"))
    )
    return {
        *_git(root, "diff", "--name-only", base),
        *_git(root, "ls-files", "--others", "--exclude-standard"),
    }


def all_files(root: Path) -> set[str]:
    """Files of the checkout, each once: links to folders are not followed."""
    listed = _git(root, "ls-files", "--cached", "--others", "--exclude-standard")
    return {name for name in listed if (root / name).is_file()}


def _imported(root: Path, name: str) -> set[str]:
    imported: set[str] = set()
    for node in ast.walk(ast.parse((root / name).read_text("utf-8"))):
        if isinstance(node, ast.Import):
            imported.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            imported.update(f"{node.module}.{alias.name}" for alias in node.names)
    return imported


def _file_of(dotted: str, files: set[str]) -> str | None:
    """Find the file of a module, or of the module that has the name.

    Folders may be linked below an import root: leading parts that are no folder of the
    checkout are left out.
    """
    parts = dotted.split(".")
    for first in range(min(2, len(parts))):
        for last in (len(parts), len(parts) - 1):
            path = "/".join(parts[first:last])
            for name in (f"{path}.py", f"{path}/__init__.py"):
                if path and name in files:
                    return name
    return None


def _is_test(name: str) -> bool:
    path = PurePosixPath(name)
    return path.parts[0] == "tests" and path.match("test_*.py")


def distances(root: Path, changed: set[str], files: set[str]) -> dict[str, int]:
    """How many imports each file is away from a changed module."""
    importers: dict[str, set[str]] = {}
    for name in files:
        if name.endswith(".py"):
            for dotted in _imported(root, name):
                if (imported := _file_of(dotted, files)) not in (None, name):
                    importers.setdefault(str(imported), set()).add(name)
    reached = {name: 0 for name in changed if name.endswith(".py")}
    edge = set(reached)
    for distance in range(1, DEPTH + 1):
        edge = {n for name in edge for n in importers.get(name, ())} - set(reached)
        reached.update(dict.fromkeys(edge, distance))
    return reached


def _named_alike(test: str, changed: Iterable[str]) -> bool:
    """Whether a test, or its folder, has the name of a changed module beside it."""
    path = PurePosixPath(test)
    for name in map(PurePosixPath, changed):
        stem = name.parent.name if name.stem == "__init__" else name.stem
        same = name.suffix == ".py" and name.parts[0] in path.parts
        is_named = f"_{stem}_" in f"{path.stem}_".replace("test_", "_", 1)
        if same and (is_named or stem == path.parent.name):
            return True
    return False


def selected(root: Path, changed: set[str]) -> list[str]:
    files = all_files(root)
    away = distances(root, changed, files)
    changed_names = {PurePosixPath(n).name for n in changed if not n.endswith(".py")}
    ranks: dict[str, float] = {}
    for test in filter(_is_test, files):
        text = (root / test).read_text("utf-8")
        if test in changed:
            ranks[test] = 0
        elif _named_alike(test, changed):
            ranks[test] = 0.5
        elif test in away:
            ranks[test] = away[test]
        elif any(name in text for name in changed_names):
            ranks[test] = 1
    words = {part for name in changed for part in PurePosixPath(name).parts[:-1]}

    def order(test: str) -> tuple[float, int, str]:
        """Nearest first; then those whose names have more of the changed folders."""
        return ranks[test], -sum(word in test for word in words), test

    return sorted(ranks, key=order)


def main(root: Path, options: list[str]) -> None:
    chosen = selected(root, changed_files(root))
    selected_files, left = chosen[:MOST_FILES], chosen[MOST_FILES:]
    lines = [
        f"tests of what has changed: {len(selected_files)} files",
        *selected_files,
        "for make test:",
    ]
    if left:
        lines.append(f"{len(left)} files further away, such as {left[0]};")
    lines.append("tests marked slow; all that is no near importer of what has changed")
    sys.stderr.write("\n  ".join(lines) + "\n")
    sys.stderr.flush()
    if selected_files:
        left = "not slow"
        pytest = [sys.executable, "-m", "pytest", "-q", "-m", left, *options]
        os.execv(sys.executable, [*pytest, *selected_files])


if __name__ == "__main__":
    main(Path(__file__).parent.parent, sys.argv[1:])
