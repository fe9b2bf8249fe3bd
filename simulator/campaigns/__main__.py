"""`python -m simulator.campaigns SPEC.toml --out DIR`: makes a campaign folder."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from kinematics.arm_file import FileError, read_arm, read_strict
from simulator.campaigns.campaign import SimulatedCampaign
from simulator.campaigns.drawing import simulate_campaign
from simulator.campaigns.siting import UnreachableError
from simulator.campaigns.spec import CampaignFile, spec_problems
from simulator.campaigns.writing import write_campaign

DONE, REFUSED = 0, 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; its exit status: 0 made, 2 the specification was refused."""
    parser = argparse.ArgumentParser(
        prog="python -m simulator.campaigns",
        description="Make a simulated identification campaign: campaign.toml and "
        "poses.csv, arm.toml with the design values, and a folder truth.",
    )
    parser.add_argument("spec", type=Path, help="specification, TOML")
    parser.add_argument("--out", type=Path, required=True, help="folder to write")
    parser.add_argument("--seed", type=int, help="in place of the specification's")
    given = parser.parse_args(arguments)
    if given.seed is not None and given.seed < 0:
        parser.error(f"--seed {given.seed} is negative; expected 0 or more")
    try:
        file = read_strict(given.spec, CampaignFile, spec_problems)
        seed = file.seed if given.seed is None else given.seed
        arm = read_arm(given.spec.parent / file.arm)
        simulated = simulate_campaign(arm, file, seed)
        write_campaign(given.out, simulated, arm)
    except FileError as error:
        problems = FileError(str(given.spec), error.problems)
        is_ours = error.source == "campaign specification"
        print(problems if is_ours else error, file=sys.stderr)  # noqa: T201 - how a command refuses a file
        return REFUSED
    except (UnreachableError, OSError) as error:
        print(f"{given.spec}: {error}", file=sys.stderr)  # noqa: T201 - as above
        return REFUSED
    print(_summary(simulated, given.out, seed))  # noqa: T201 - what the command reports
    return DONE


def _summary(simulated: SimulatedCampaign, folder: Path, seed: int) -> str:
    """What was made, line by line."""
    campaign, truth = simulated.campaign, simulated.truth
    touched = [f"{a.id} ({a.kind})" for a in campaign.artefacts]
    return "\n".join(
        [
            f"made {folder} seed {seed}",
            f"poses {campaign.n_poses}",
            f"artefacts {len(touched)}: {', '.join(touched)}",
            f"blunders {len(truth.blunders)}",
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
