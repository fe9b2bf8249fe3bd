"""`python -m benchmarks.kernel_instructions`: instructions a pose, on aarch64.

The portable kernel is built for aarch64 and for x86-64 with the flags of setup.py, run
in an emulator that reports every instruction, and counted: the difference between 2048
and 1024 centres of an arm of seven joints. Needs a cross compiler and qemu's user mode
(`sh deploy/debian-packages.sh aarch64`).
"""

import re
import subprocess
import tempfile
from collections import Counter
from pathlib import Path

from benchmarks.tools.command_line import run_main

ROOT = Path(__file__).parent.parent
KERNEL = ROOT / "kinematics" / "kernel"
FLAGS = ("-O3", "-ffp-contract=off", "-fno-math-errno", "-static", f"-I{KERNEL}")
SIZES = (1024, 2048)
TARGETS = {
    "aarch64": ("aarch64-linux-gnu-", ("qemu-aarch64",)),
    "x86-64": ("", ("qemu-x86_64", "-cpu", "max")),
}
VECTOR = {"aarch64": r"v\d+\.2d|\bq\d+", "x86-64": r"\b\w+pd\b|\bmovap|\bmovup"}
ARITHMETIC = {
    "aarch64": r"^(fadd|fsub|fmul|fneg|frint\w+|fcvt\w+|scvtf)\b",
    "x86-64": r"^(add|sub|mul|xor|cvt\w+)[ps]d\b|^cvt",
}


def counted(name: str, folder: Path) -> tuple[Counter[str], str, int]:
    """Return instructions a pose by kind, the printed sums, and vectorised loops."""
    prefix, emulator = TARGETS[name]
    program = folder / f"rows-{name}"
    sources = (str(KERNEL / "variants.c"), str(ROOT / "benchmarks/tools/kernel_rows.c"))
    built = subprocess.run(
        [
            f"{prefix}gcc",
            *FLAGS,
            "-fopt-info-vec-optimized",
            *sources,
            "-lm",
            "-o",
            program,
        ],
        check=True,
        capture_output=True,
        text=True,
    )
    loops = set(re.findall(r"(\S+:\d+):\d+: optimized: loop vectorized", built.stderr))
    listing = subprocess.run(
        [f"{prefix}objdump", "-d", "--no-show-raw-insn", program],
        check=True,
        capture_output=True,
        text=True,
    )
    texts = dict(re.findall(r"^ *([0-9a-f]+):\t(.+)$", listing.stdout, re.MULTILINE))
    kinds = {int(address, 16): kind(name, text) for address, text in texts.items()}
    totals, sums = [], []
    for n in SIZES:
        log = folder / f"log-{name}"
        traced = ("-singlestep", "-d", "nochain,exec", "-D", str(log))
        words = [*emulator, *traced, str(program), str(n)]
        run = subprocess.run(words, check=True, capture_output=True, text=True)
        with log.open() as lines:
            places = (int(line.split("/")[1], 16) for line in lines if "/" in line)
            totals.append(Counter(kinds.get(place, "other") for place in places))
        sums.append(run.stdout.strip())
        log.unlink()
    (few, many), n_added = totals, SIZES[1] - SIZES[0]
    each = {k: round((many[k] - few[k]) / n_added, 1) for k in many}
    return Counter(each), " ".join(sums), len(loops)


def kind(target: str, text: str) -> str:
    is_vector = re.search(VECTOR[target], text)
    if re.search(ARITHMETIC[target], text):
        return "arithmetic of two at once" if is_vector else "arithmetic of one"
    return "moves of two at once" if is_vector else "other"


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        by_target = {name: counted(name, Path(folder)) for name in TARGETS}
    for name, (counts, _, n_loops) in by_target.items():
        print(f"{name}: {sum(counts.values()):.0f} instructions a pose")
        for text, n in sorted(counts.items()):
            print(f"    {n:6.1f} {text}")
        print(
            f"    {n_loops} loops of the sources vectorised, by the compiler's report"
        )
    same = len({sums for _, sums, _ in by_target.values()}) == 1
    print("the bits of both are the same" if same else "THE BITS DIFFER")
    return 0 if same else 1


if __name__ == "__main__":
    run_main(main)
