"""Runs fuzz targets under atheris.

    python -m tests.fuzz --seconds 60            all targets, one process each
    python -m tests.fuzz rls --seconds 600       one of them
    python -m tests.fuzz --together --runs 20000 all in one process

What breaks a target is kept in build/fuzz/, as `crash-...`; give such a file to
`python -m tests.fuzz NAME --again FILE`.
"""

import argparse
import importlib
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

FOLDER = Path(__file__).parent
NAMES = sorted(path.stem[len("fuzz_") :] for path in FOLDER.glob("fuzz_*.py"))
KEPT = FOLDER.parent.parent / "build" / "fuzz"


def target(name: str) -> tuple[tuple[bytes, ...], Callable[[bytes], None]]:
    module = importlib.import_module(f"tests.fuzz.fuzz_{name}")
    return module.SEEDS, module.check


def together() -> tuple[tuple[bytes, ...], Callable[[bytes], None]]:
    """All targets in one: the first byte chooses."""
    targets = [target(name) for name in NAMES]
    seeds = [bytes((n,)) + s for n, (samples, _) in enumerate(targets) for s in samples]

    def check(data: bytes) -> None:
        number = data[0] % len(targets) if data else 0
        targets[number][1](data[1:])

    return tuple(seeds), check


def fuzz(name: str | None, limits: list[str]) -> None:
    import atheris  # noqa: PLC0415 - slow, and only here

    with atheris.instrument_imports(include=["traverse", "pymodbus.framer"]):
        seeds, check = together() if name is None else target(name)
    KEPT.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as corpus:
        for number, seed in enumerate(seeds):
            (Path(corpus) / f"seed-{number}").write_bytes(seed)
        options = [f"-artifact_prefix={KEPT}/", "-max_len=400", "-timeout=5"]
        atheris.Setup([sys.argv[0], *limits, *options, corpus], check)
        atheris.Fuzz()


def fuzz_all(seconds: float) -> int:
    each_s = max(1, round(seconds / len(NAMES)))
    failed = []
    for name in NAMES:
        command = [sys.executable, "-m", "tests.fuzz", name, f"--seconds={each_s}"]
        done = subprocess.run(
            command,
            check=False,
            cwd=FOLDER.parent.parent,
            capture_output=True,
            text=True,
        )
        runs = re.findall(r"^Done (\d+) runs", done.stderr, re.MULTILINE)
        cover = re.findall(r"cov: (\d+)", done.stderr)
        words = "ok" if done.returncode == 0 else "BROKEN"
        n_runs, n_cover = (list_[-1] if list_ else "?" for list_ in (runs, cover))
        line = f"{name:14} {n_runs:>9} runs, {n_cover:>5} branches   {words}"
        sys.stdout.write(line + "\n")
        if done.returncode:
            failed.append(name)
            sys.stderr.write(done.stdout[-4000:] + done.stderr[-4000:])
    return 1 if failed else 0


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz")
    parser.add_argument("name", nargs="?", choices=NAMES)
    parser.add_argument("--seconds", type=float)
    parser.add_argument("--runs", type=int)
    parser.add_argument("--together", action="store_true")
    parser.add_argument("--again", type=Path, help="a file that broke the target")
    arguments = parser.parse_args()
    if arguments.again is not None and arguments.name is not None:
        target(arguments.name)[1](arguments.again.read_bytes())
        return 0
    if arguments.name is None and not arguments.together:
        return fuzz_all(arguments.seconds or 60.0)
    limits = (
        [f"-max_total_time={round(arguments.seconds)}"] if arguments.seconds else []
    )
    limits += [f"-runs={arguments.runs}"] if arguments.runs else []
    fuzz(None if arguments.together else arguments.name, limits)
    return 0


if __name__ == "__main__":
    sys.exit(main())
