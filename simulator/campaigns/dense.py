"""`python -m simulator.campaigns.dense SPEC.toml --out DIR`: makes a dense scan."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from kinematics.arm_file import FileError, read_arm, read_strict
from simulator.campaigns.dense_scan import NOTHING, DenseScan, simulate_scan
from simulator.campaigns.dense_spec import DenseFile, dense_problems
from simulator.campaigns.dense_writing import write_scan
from simulator.campaigns.siting import UnreachableError

DONE, REFUSED = 0, 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; its exit status: 0 made, 2 the specification was refused."""
    parser = argparse.ArgumentParser(
        prog="python -m simulator.campaigns.dense",
        description="Make a simulated dense scan: campaign.toml and scan.mcap, "
        "arm.toml with the design values, truth/arm.toml with the true ones.",
    )
    parser.add_argument("spec", type=Path, help="specification, TOML")
    parser.add_argument("--out", type=Path, required=True, help="folder to write")
    parser.add_argument("--seed", type=int, help="in place of the specification's")
    given = parser.parse_args(arguments)
    if given.seed is not None and given.seed < 0:
        parser.error(f"--seed {given.seed} is negative; expected 0 or more")
    try:
        file = read_strict(given.spec, DenseFile, dense_problems)
        seed = file.seed if given.seed is None else given.seed
        arm = read_arm(given.spec.parent / file.arm)
        scan = simulate_scan(arm, file, seed)
        write_scan(given.out, scan, seed)
    except FileError as error:
        problems = FileError(str(given.spec), error.problems)
        is_ours = error.source == "campaign specification"
        print(problems if is_ours else error, file=sys.stderr)  # noqa: T201 - how a command refuses a file
        return REFUSED
    except (UnreachableError, OSError) as error:
        print(f"{given.spec}: {error}", file=sys.stderr)  # noqa: T201 - as above
        return REFUSED
    print(_summary(scan, given.out, seed))  # noqa: T201 - what the command reports
    return DONE


def _summary(scan: DenseScan, folder: Path, seed: int) -> str:
    """What was made, line by line."""
    touching = int(np.count_nonzero(scan.touched != NOTHING))
    names = ", ".join(f"{a.id} ({a.kind})" for a in scan.artefacts)
    return "\n".join(
        [
            f"made {folder} seed {seed}",
            f"samples {len(scan.time_s)}, {touching} of them touching",
            f"artefacts {len(scan.artefacts)}: {names}",
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
