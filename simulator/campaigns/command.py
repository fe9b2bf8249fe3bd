"""Common parts of the commands that make campaigns."""

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from traverse.kinematics.arm_file.arm import Arm, read_arm
from traverse.simulator.campaigns.siting import UnreachableError
from traverse.simulator.campaigns.spec import CampaignFile
from traverse.strict_toml.problems import FileError

DONE, REFUSED = 0, 2

File = TypeVar("File", bound=CampaignFile)


def run_command(
    name: str,
    description: str,
    read: Callable[[Path], File],
    make: Callable[[Path, Arm, File, int], Sequence[str]],
    arguments: Sequence[str] | None,
) -> int:
    """Run a command; return 0, or 2 if the specification was refused.

    ``make`` gets the folder, the arm, the specification and the seed, and returns a
    summary.
    """
    parser = argparse.ArgumentParser(prog=name, description=description)
    parser.add_argument("spec", type=Path, help="specification, TOML")
    parser.add_argument("--out", type=Path, required=True, help="folder to write")
    parser.add_argument("--seed", type=int, help="in place of the specification's")
    given = parser.parse_args(arguments)
    if given.seed is not None and given.seed < 0:
        parser.error(f"--seed {given.seed} is negative; expected 0 or more")
    try:
        file = read(given.spec)
        seed = file.seed if given.seed is None else given.seed
        summary = make(given.out, read_arm(given.spec.parent / file.arm), file, seed)
    except FileError as error:
        problems = FileError(given.spec, error.problems)
        is_ours = error.source == "campaign specification"
        print(problems if is_ours else error, file=sys.stderr)  # noqa: T201 - how a command refuses a file
        return REFUSED
    except (UnreachableError, OSError) as error:
        print(f"{given.spec}: {error}", file=sys.stderr)  # noqa: T201 - as above
        return REFUSED
    print("\n".join([f"made {given.out} seed {seed}", *summary]))  # noqa: T201 - what the command reports
    return DONE
