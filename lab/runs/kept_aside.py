"""An identification of some poses, and how well it predicts the others."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.adjustment import IdentificationError, Options
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.holdout import SPLITS
from traverse.lab.identification.prediction import holdout_figures
from traverse.lab.identification.results.result import Identification
from traverse.lab.outcomes.adjustment import Progress
from traverse.lab.runs.identification import identified
from traverse.lab.runs.inputs import BreakdownError, broken_down


@dataclass(frozen=True, slots=True)
class KeptAside:
    """Poses that take no part: which part of all, by time or artefact, from a seed."""

    part: float
    by: str
    seed: int

    def split(self, campaign: Campaign) -> tuple[Campaign, Campaign]:
        """Return the poses that take part, and the others.

        Raises:
            IdentificationError: None can be kept aside.
        """
        inside, outside = SPLITS[self.by](campaign, self.seed, self.part)
        if not outside.any():
            raise IdentificationError(
                f"nothing can be kept aside of {len(campaign.poses)} poses at "
                f"{len(campaign.artefacts)} artefacts by {self.by}: the rest would not "
                "determine the arm or an artefact; measure more, or leave --holdout out"
            )
        return campaign.part(inside), campaign.part(outside)


def identified_and_predicted(
    campaign: Campaign,
    arm: Arm,
    options: Options,
    kept_aside: KeptAside,
    progress: Callable[[Campaign], Progress] | None = None,
) -> Identification:
    """Identify from some poses, and predict the others.

    Progress is made for the poses that take part.

    Raises:
        IdentificationError: Arm, campaign and options are inconsistent.
        BreakdownError: The adjustment broke down.
    """
    chosen, held_out = kept_aside.split(campaign)
    show = None if progress is None else progress(chosen)
    result = identified(chosen, arm, options, show)
    if not result.converged:
        return result
    try:
        figures = holdout_figures(result, held_out, kept_aside.by, kept_aside.seed)
    except np.linalg.LinAlgError as error:
        raise BreakdownError(broken_down(chosen, error)) from error
    return replace(result, holdout=figures)
