"""What the steps of an identification hand on: its start, its solution, its weights."""

from dataclasses import dataclass, replace

from traverse.arrays import Booleans
from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.adjustment import (
    Adjustment,
    ArmValues,
    IteratedAdjustment,
    Noise,
    Options,
    Problem,
    adjust_iteratively,
)
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.identification.certificates import ContactShift, Contradiction
from traverse.lab.identification.stream_noise import SerialNoise
from traverse.lab.identification.wrong_orientations import WrongOrientation
from traverse.lab.outcomes.progress import Iteration, Progress
from traverse.lab.statistics.outlier_clusters import ExcludedCluster

# Of a hypothesis: a wrong one creeps, a right one is there by then.
_MOST_OF_A_TRIAL = 25


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """What an adjustment begins with.

    Attributes:
        source: The arm as given; `arm` has what masses are assumed beside that.
        problem: With the values of that arm.
        rms_before_mm: Of the misclosures with the arm as given.
        orientation_rms_before_rad: Likewise of orientations, 0 without any.
        design: As given, with free tools fitted and wrong signs reversed.
        begin: Where the adjustment begins: the design, or one with other zeros.
        reversed_joints: Numbers of the joints whose signs were wrong.
    """

    source: Arm
    arm: Arm
    problem: Problem
    options: Options
    progress: Progress | None
    rms_before_mm: float
    orientation_rms_before_rad: float
    design: ArmValues
    begin: ArmValues
    reversed_joints: tuple[int, ...]

    @property
    def campaign(self) -> Campaign:
        """As measured."""
        return self.problem.campaign

    def adjusted(
        self,
        campaign: Campaign,
        noise: Noise | None = None,
        never_excluded: Booleans | None = None,
        begin: ArmValues | None = None,
    ) -> IteratedAdjustment:
        """Adjust a campaign, with a given noise only as long as a trial deserves."""
        options, most = self.options, None
        if noise is not None:
            options, most = options.with_noise_held, _MOST_OF_A_TRIAL
        return adjust_iteratively(
            replace(self.problem, campaign=campaign).network(noise=noise),
            self.begin if begin is None else begin,
            options,
            never_excluded=never_excluded,
            progress=self.progress,
            most_iterations=most,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """An adjustment of a campaign, and what contradicted the rest of it.

    Attributes:
        begin: Where the adjustment began.
        design: From which changes are counted.
    """

    campaign: Campaign
    run: IteratedAdjustment
    begin: ArmValues
    design: ArmValues
    contradictions: tuple[Contradiction, ...] = ()
    contact_shift: ContactShift | None = None
    wrong_orientations: tuple[WrongOrientation, ...] = ()
    clusters: tuple[ExcludedCluster, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Weighted:
    """The last adjustment, in which samples of a stream weigh what they say together.

    Attributes:
        samples_per_square: How many squares of residuals say as much as one.
    """

    adjustment: Adjustment
    iterations: tuple[Iteration, ...]
    sigma0: float
    redundancy: int
    serial: SerialNoise | None = None
    samples_per_square: float = 1.0
