import ast
import subprocess
import sys

import pytest

from benchmarks.tools.command_line import run_main
from tests.docs.pages import CHECKOUT

READERS = ("run_main", "argparse", "typer", "Program")


def programs():
    for folder in ("benchmarks", "deploy"):
        for path in sorted((CHECKOUT / folder).rglob("*.py")):
            if '__name__ == "__main__"' in path.read_text("utf-8"):
                yield path.relative_to(CHECKOUT)


def test_a_program_reads_its_arguments_by_a_reader_that_knows_help():
    for path in programs():
        text = (CHECKOUT / path).read_text("utf-8")
        nodes = ast.walk(ast.parse(text))
        names = {node.id for node in nodes if isinstance(node, ast.Name)}
        assert names & set(READERS), path
        assert "sys.argv[1]" not in text, path


def test_help_is_no_file_to_write(tmp_path):
    run = subprocess.run(
        [sys.executable, "-m", "benchmarks.service.stages", "--help"],
        cwd=tmp_path,
        env={"PYTHONPATH": str(CHECKOUT)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout.startswith("usage: python -m benchmarks.service.stages")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "seen"),
    [
        ([], (1.5, None, ())),
        (["2"], (2.0, None, ())),
        (["2", "x", "3", "4"], (2.0, "x", (3, 4))),
    ],
)
def test_parameters_are_arguments(monkeypatch, words, seen):
    calls = []

    async def main(seconds: float = 1.5, file: str | None = None, *numbers: int) -> int:
        calls.append((seconds, file, numbers))
        return 3

    monkeypatch.setattr(sys, "argv", ["program", *words])
    with pytest.raises(SystemExit) as ended:
        run_main(main)
    assert (ended.value.code, calls) == (3, [seen])


@pytest.mark.parametrize("words", [["--help"], ["-h"], ["long"], ["1", "2"]])
def test_other_arguments_do_not_run_it(monkeypatch, capsys, words):
    def main(seconds: float) -> None:
        raise AssertionError

    monkeypatch.setattr(sys, "argv", ["program", *words])
    with pytest.raises(SystemExit) as ended:
        run_main(main)
    assert ended.value.code == (0 if words[0].startswith("-") else 2)
    assert "SECONDS" in "".join(capsys.readouterr())
