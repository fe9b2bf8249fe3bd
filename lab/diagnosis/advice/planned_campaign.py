"""What a campaign would show, before anything is measured.

The poses are taken as they are and the arm as it is given; no misclosure is looked
at. Only the artefacts' places are found from the readings.
"""

from dataclasses import replace
from glob import escape

import numpy as np

from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.diagnosis.advice.minimal_detectable import detectable
from traverse.lab.diagnosis.candidates.library import absent_candidates, library_bank
from traverse.lab.diagnosis.model.observation_equations import (
    ObservationEquations,
    equations_of,
)
from traverse.lab.diagnosis.model.result import Detectable
from traverse.lab.identification.equations.effect_model import effect_model
from traverse.lab.identification.equations.network import Network, stations
from traverse.lab.identification.equations.noise import a_priori_noise
from traverse.lab.identification.equations.station_equations import start_state
from traverse.lab.identification.identify import prepared
from traverse.lab.identification.solve.adjustment import adjust
from traverse.lab.identification.solve.options import Options


def planned(campaign: Campaign, arm: Arm) -> tuple[Detectable, ...]:
    """Say how large effects must be for a campaign to show them.

    Args:
        campaign: With the poses that are planned, or measured; its noise, or usual
            noise, counts.
        arm: The design, or an identified arm; its effects are estimated too.

    Raises:
        IdentificationError: The campaign does not tell what the arm's effects need.
    """
    rows = planned_equations(campaign, arm)
    return detectable(rows, library_bank(rows, arm), absent_candidates(rows, arm))


def planned_equations(campaign: Campaign, arm: Arm) -> ObservationEquations:
    """Set up the rows of a campaign at an arm as it is given, nothing contradicting."""
    free: tuple[str, ...] = ()
    if arm.effects:
        model = effect_model(arm, arm.effects, campaign)
        free = tuple(escape(name) for name in model.names)
    design, parameters = prepared(campaign, arm, Options(free=free))
    everyone = np.ones(len(campaign.poses), dtype=np.bool_)
    network = Network(
        campaign,
        stations(campaign, arm.probe.radius_mm, everyone),
        parameters,
        a_priori_noise(campaign),
        np.ones(len(campaign.poses)),
    )
    here = adjust(network, start_state(network, design), design, None, 0)
    rows = equations_of(here)
    return replace(rows, values=np.zeros(len(rows.values)))
