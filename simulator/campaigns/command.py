"""The commands that make campaigns and dense scans."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from traverse.kinematics.arm_file.arm import Arm, read_arm
from traverse.simulator.campaigns.dense.scan import NOTHING, simulate_scan
from traverse.simulator.campaigns.dense.spec import DenseFile, dense_problems
from traverse.simulator.campaigns.dense.writing import write_scan
from traverse.simulator.campaigns.drawing import simulate_campaign
from traverse.simulator.campaigns.siting import UnreachableError
from traverse.simulator.campaigns.spec import CampaignFile, spec_problems
from traverse.simulator.campaigns.writing import write_campaign
from traverse.strict_toml.problems import FileError
from traverse.strict_toml.reader import read_strict

DONE, REFUSED = 0, 2

File = TypeVar("File", bound=CampaignFile)


def campaign_made(specification: Path, out: Path, seed: int | None) -> int:
    """Make a campaign; return 0, or 2 if something was refused."""
    return _made(specification, out, seed, _read_campaign, _make_campaign)


def scan_made(specification: Path, out: Path, seed: int | None) -> int:
    """Make a dense scan; return 0, or 2 if something was refused."""
    return _made(specification, out, seed, _read_scan, _make_scan)


def _read_campaign(path: Path) -> CampaignFile:
    return read_strict(path, CampaignFile, spec_problems)


def _make_campaign(folder: Path, arm: Arm, file: CampaignFile, seed: int) -> list[str]:
    simulated = simulate_campaign(arm, file, seed)
    write_campaign(folder, simulated, arm)
    campaign = simulated.campaign
    touched = [f"{a.id} ({a.kind})" for a in campaign.artefacts]
    return [
        f"poses {campaign.n_poses}",
        f"artefacts {len(touched)}: {', '.join(touched)}",
        f"blunders {len(simulated.truth.blunders)}",
    ]


def _read_scan(path: Path) -> DenseFile:
    return read_strict(path, DenseFile, dense_problems)


def _make_scan(folder: Path, arm: Arm, file: DenseFile, seed: int) -> list[str]:
    scan = simulate_scan(arm, file, seed)
    write_scan(folder, scan, seed)
    touching = int(np.count_nonzero(scan.touched != NOTHING))
    names = ", ".join(f"{a.id} ({a.kind})" for a in scan.artefacts)
    return [
        f"samples {len(scan.touched)}, {touching} of them touching",
        f"artefacts {len(scan.artefacts)}: {names}",
    ]


def _made(
    specification: Path,
    out: Path,
    seed: int | None,
    read: Callable[[Path], File],
    make: Callable[[Path, Arm, File, int], Sequence[str]],
) -> int:
    try:
        file = read(specification)
        seed = file.seed if seed is None else seed
        summary = make(out, read_arm(specification.parent / file.arm), file, seed)
    except FileError as error:
        problems = FileError(specification, error.problems)
        is_ours = error.source == "campaign specification"
        print(problems if is_ours else error, file=sys.stderr)  # noqa: T201 - how a command refuses a file
        return REFUSED
    except (UnreachableError, OSError) as error:
        print(f"{specification}: {error}", file=sys.stderr)  # noqa: T201 - as above
        return REFUSED
    print("\n".join([f"made {out} seed {seed}", *summary]))  # noqa: T201 - what the command reports
    return DONE
