"""Make a dense scan.

`python -m traverse.simulator.campaigns.dense SPEC.toml --out DIR`
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from traverse.kinematics.arm_file.arm import Arm
from traverse.simulator.campaigns.command import run_command
from traverse.simulator.campaigns.dense.scan import NOTHING, simulate_scan
from traverse.simulator.campaigns.dense.spec import DenseFile, dense_problems
from traverse.simulator.campaigns.dense.writing import write_scan
from traverse.strict_toml.reader import read_strict


def main(arguments: Sequence[str] | None = None) -> int:
    return run_command(
        "python -m traverse.simulator.campaigns.dense",
        "Make a simulated dense scan: campaign.toml and scan.mcap, "
        "arm.toml with the design values, truth/arm.toml with the true ones.",
        lambda spec: read_strict(spec, DenseFile, dense_problems),
        _made,
        arguments,
    )


def _made(folder: Path, arm: Arm, file: DenseFile, seed: int) -> list[str]:
    scan = simulate_scan(arm, file, seed)
    write_scan(folder, scan, seed)
    touching = int(np.count_nonzero(scan.touched != NOTHING))
    names = ", ".join(f"{a.id} ({a.kind})" for a in scan.artefacts)
    return [
        f"samples {len(scan.touched)}, {touching} of them touching",
        f"artefacts {len(scan.artefacts)}: {names}",
    ]


if __name__ == "__main__":
    sys.exit(main())
