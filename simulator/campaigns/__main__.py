"""Make a campaign folder.

`python -m traverse.simulator.campaigns SPEC.toml --out DIR`
"""

import sys
from collections.abc import Sequence
from pathlib import Path

from traverse.kinematics.arm_file.arm import Arm
from traverse.simulator.campaigns.command import run_command
from traverse.simulator.campaigns.drawing import simulate_campaign
from traverse.simulator.campaigns.spec import CampaignFile, spec_problems
from traverse.simulator.campaigns.writing import write_campaign
from traverse.strict_toml.reader import read_strict


def main(arguments: Sequence[str] | None = None) -> int:
    return run_command(
        "python -m traverse.simulator.campaigns",
        "Make a simulated identification campaign: campaign.toml and "
        "poses.csv, arm.toml with the design values, and a folder truth.",
        lambda spec: read_strict(spec, CampaignFile, spec_problems),
        _made,
        arguments,
    )


def _made(folder: Path, arm: Arm, file: CampaignFile, seed: int) -> list[str]:
    simulated = simulate_campaign(arm, file, seed)
    write_campaign(folder, simulated, arm)
    campaign = simulated.campaign
    touched = [f"{a.id} ({a.kind})" for a in campaign.artefacts]
    return [
        f"poses {campaign.n_poses}",
        f"artefacts {len(touched)}: {', '.join(touched)}",
        f"blunders {len(simulated.truth.blunders)}",
    ]


if __name__ == "__main__":
    sys.exit(main())
