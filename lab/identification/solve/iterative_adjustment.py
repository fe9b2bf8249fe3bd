"""The rounds of an identification: adjust, test, improve the noise, and again."""

from dataclasses import replace

import numpy as np

from traverse.arrays import Booleans
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.identification.equations.network import Network, State, stations
from traverse.lab.identification.equations.noise import Noise
from traverse.lab.identification.equations.parameters import ArmValues
from traverse.lab.identification.equations.station_equations import start_state
from traverse.lab.identification.solve.adjustment import (
    Adjustment,
    Iteration,
    Progress,
    adjust,
)
from traverse.lab.identification.solve.options import Options
from traverse.lab.identification.solve.pose_statistics import (
    PoseStatistics,
    pose_statistics,
    statistics_of_excluded,
)
from traverse.lab.identification.solve.robust_start import robust_state
from traverse.lab.identification.solve.serial_noise import SerialNoise
from traverse.lab.identification.solve.snooping import (
    SnoopingResult,
    robust_scale,
    snoop,
)
from traverse.lab.identification.solve.variance_components import (
    VarianceModel,
    better_noise,
    variance_model,
)

_MOST_ROUNDS = 15
# Standard deviations that change by less than this are settled.
_NOISE_SETTLED = 0.01
# A classical sigma0 this much above the robust one betrays blunders.
_BLUNDERS = 1.2


class IterativeAdjustment:
    """Adjusts until neither the poses that take part nor the noise change."""

    def __init__(
        self,
        design: ArmValues,
        options: Options,
        radius_mm: float,
        progress: Progress | None,
    ) -> None:
        self._design = design
        self._options = options
        self._radius_mm = radius_mm
        self._progress = progress
        self.iterations: list[Iteration] = []

    def variances(self, campaign: Campaign) -> VarianceModel:
        """Say which noise is estimated."""
        return self._options.variances or variance_model(campaign)

    def run(
        self, network: Network, first: Booleans | None = None
    ) -> tuple[Adjustment, PoseStatistics, Booleans, float]:
        """Adjust until nothing changes.

        Args:
            network: With the stations' poses that may take part.
            first: Poses that take part to begin with, (n_poses,); default all.

        Returns:
            Adjustment, statistics of all poses, who took part, critical |w|.
        """
        campaign = network.campaign
        variances = self.variances(campaign)
        eligible = np.zeros(len(campaign.poses), dtype=np.bool_)
        for station in network.stations:
            eligible[station.poses] = True
        included = eligible.copy()
        state = start_state(network, self._design)
        if first is None:
            adjustment = self._adjusted(network, state)
            found = pose_statistics(adjustment)
        else:
            included = eligible & first
            adjustment, found = self._without(network, included, self._design)
        if self._options.snooping and (
            not adjustment.converged
            or adjustment.sigma0 > _BLUNDERS * robust_scale(found)
        ):
            state, included = robust_state(network, state, self._design)
            included &= eligible
            adjustment, found = self._without(network, included, state.arm)
        critical = float("inf")
        for _ in range(_MOST_ROUNDS):
            noise, change = better_noise(
                campaign, adjustment.network.noise, found.variances, variances
            )
            tests = self._tests(adjustment, found, (included, eligible), variances)
            if tests is not None:
                critical = tests.critical * tests.scale
            n_changed = tests.n_changed if tests is not None else 0
            if change < _NOISE_SETTLED and n_changed == 0:
                break
            included = included if tests is None else tests.included
            adjustment, found = self._without(
                adjustment.network, included, adjustment.state.arm, noise
            )
        return adjustment, self._of_all(adjustment, found, included), included, critical

    def with_stream_weights(self, alone: Adjustment, serial: SerialNoise) -> Adjustment:
        """Adjust once more, samples of a stream weighed by what they say together.

        Certificates keep their weight: a standard is as uncertain as it was.
        """
        weights = alone.network.weights / serial.samples_per_mean
        network = replace(alone.network, weights=weights)
        return self._adjusted(network, alone.state)

    def _adjusted(self, network: Network, state: State) -> Adjustment:
        return adjust(network, state, self._design, self._told)

    def _told(self, iteration: Iteration) -> None:
        self.iterations.append(iteration)
        if self._progress is not None:
            self._progress(iteration)

    def _without(
        self,
        before: Network,
        included: Booleans,
        arm: ArmValues,
        noise: Noise | None = None,
    ) -> tuple[Adjustment, PoseStatistics]:
        network = Network(
            before.campaign,
            stations(before.campaign, self._radius_mm, included),
            before.parameters,
            noise or before.noise,
            before.weights,
        )
        found = self._adjusted(network, start_state(network, arm))
        return found, pose_statistics(found)

    def _tests(
        self,
        adjustment: Adjustment,
        found: PoseStatistics,
        masks: tuple[Booleans, Booleans],
        variances: VarianceModel,
    ) -> SnoopingResult | None:
        if not self._options.snooping:
            return None
        return snoop(
            adjustment,
            found,
            *masks,
            family_level=self._options.family_level,
            noise_known=not variances.estimates,
            radius_mm=self._radius_mm,
        )

    def _of_all(
        self, adjustment: Adjustment, found: PoseStatistics, included: Booleans
    ) -> PoseStatistics:
        """Fill in the statistics of the excluded poses."""
        if np.all(included):
            return found
        campaign = adjustment.network.campaign
        others = stations(campaign, self._radius_mm, ~included)
        theirs = statistics_of_excluded(adjustment, others)
        outside = ~included
        for name in (
            "misclosures_mm",
            "statistics",
            "w",
            "degrees",
            "controllability",
            "detectable_mm",
            "influence",
            "corrections_rad",
        ):
            getattr(found, name)[outside] = getattr(theirs, name)[outside]
        return found
