"""The result of an identification: rich, frozen, and all that a report needs."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from traverse.arrays import Booleans, Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.adjustment import Adjustment, Noise, Options, PoseStatistics
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.identification.certificates import (
    ContactShift,
    LostPoses,
)
from traverse.lab.identification.optimal_design import JointCoverage
from traverse.lab.identification.results.orientations import OrientationResult
from traverse.lab.identification.results.undetermined import Undetermined
from traverse.lab.identification.stream_noise import SerialNoise
from traverse.lab.outcomes.adjustment import CartesianCovariance, Iteration
from traverse.lab.outcomes.identified import (
    ContradictedCertificate,
    ExcludedPose,
    ParameterEstimate,
    Suggestion,
    Weak,
)
from traverse.lab.statistics.distributions import GlobalTest
from traverse.lab.statistics.outlier_clusters import ExcludedCluster


@dataclass(frozen=True, slots=True)
class EstimatedLength:
    """A length of an artefact.

    Attributes:
        name: For example `distance_mm`.
        value_mm: As the arm measures it: its own certificate is left out, unless
            nothing else says how long anything is.
        std_mm: Standard deviation of that.
    """

    name: str
    value_mm: float
    std_mm: float


@dataclass(frozen=True, slots=True)
class ArtefactResult:
    """Result for an artefact.

    Attributes:
        n_poses: That took part.
        rms_mm: Root mean square of scalar misclosures of the poses that took part.
        mean_distance_mm: Mean length of the misclosures of known points, else None.
        n_all: Poses that were measured.
        rms_all_mm: As `rms_mm`, of all poses, the excluded ones too.
        mean_distance_all_mm: As `mean_distance_mm`, likewise.
        contact_mm: Standard deviation of a contact that was used.
        place: Its place in the arm's system, by the keys of its kind.
    """

    id: str
    kind: str
    n_poses: int
    rms_mm: float
    mean_distance_mm: float | None
    n_all: int
    rms_all_mm: float
    mean_distance_all_mm: float | None
    lengths: tuple[EstimatedLength, ...]
    contact_mm: float
    place: Mapping[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class Identification:
    """An identified arm, with its uncertainty and diagnostics.

    Attributes:
        arm: With the estimates and, in `[identification]`, their provenance.
        adjustment: The last one, with state, system and rank. Samples of a stream
            have as little weight in it as they have to say.
        iterations: Of all adjustments, in order.
        sigma0: A-posteriori standard deviation of unit weight.
        redundancy: Equations and certificates less determined unknowns, which take
            more than one each from the samples of a stream.
        variance_factor: By what cofactors of the arm were multiplied to give its
            covariance: 1 where the noise is known and sigma0 does not contradict it
            upwards, else all that noise does not explain counts.
        serial_noise: What neighbouring samples of a stream share; None: single poses.
        rms_before_mm: Of scalar misclosures with the design.
        rms_after_mm: Of those of the poses that took part, with the estimates.
        covariance: Of the free parameters, (n_free, n_free).
        cartesian: The same over xyz components.
        undetermined: What the data do not say.
        weak: What they hardly say.
        statistics: Of every pose; of excluded ones against the estimates.
        included: Which poses took part, (n_poses,).
        alternating: Lines of the excluded ones that contradict the others only while
            they take part.
        critical_w: Above which a pose was excluded.
        condition_number: Of the arm's determined, column-scaled system.
        contradictions: Certificates that contradict the rest and took no part.
        contact_shift: What the contacts with all certified radii share, or None.
        wrong_signs: Joints that turn the other way than the design says.
        lost_poses: Artefacts that lost more than a fifth of their poses.
        clusters: Where poses that contradicted the others lay together.
        zero_offsets_rad: Added to the zeros by the coarse start, (n_joints,).
        holdout: How poses that were kept aside are predicted, or None.
        orientations: Of measured orientations, or None without any.
    """

    arm: Arm
    design: Arm
    campaign: Campaign
    adjustment: Adjustment
    converged: bool
    iterations: tuple[Iteration, ...]
    sigma0: float
    redundancy: int
    global_test: GlobalTest
    variance_factor: float
    noise: Noise
    serial_noise: SerialNoise | None
    rms_before_mm: float
    rms_after_mm: float
    parameters: tuple[ParameterEstimate, ...]
    covariance: Floats
    cartesian: CartesianCovariance
    undetermined: tuple[Undetermined, ...]
    weak: tuple[Weak, ...]
    artefacts: tuple[ArtefactResult, ...]
    statistics: PoseStatistics
    included: Booleans
    excluded: tuple[ExcludedPose, ...]
    alternating: tuple[int, ...]
    critical_w: float
    coverage: tuple[JointCoverage, ...]
    condition_number: float
    contradictions: tuple[ContradictedCertificate, ...]
    contact_shift: ContactShift | None
    wrong_signs: tuple[str, ...]
    lost_poses: tuple[LostPoses, ...]
    clusters: tuple[ExcludedCluster, ...]
    suggestions: tuple[Suggestion, ...]
    zero_offsets_rad: Floats
    options: Options
    holdout: Mapping[str, Any] | None = None
    orientations: OrientationResult | None = None

    @property
    def tools_mm(self) -> dict[str, Floats]:
        """Vectors of the campaign's tools by their names, (3,)."""
        vectors_mm = self.adjustment.state.arm.tools_mm
        names = [tool.name for tool in self.campaign.tools]
        return dict(zip(names, vectors_mm, strict=True))

    @property
    def tools(self) -> dict[str, dict[str, list[Any]]]:
        """Say vectors of tools, and standard deviations, None of what is held."""
        stds = {entry.name: entry.std for entry in self.parameters}
        return {
            name: {
                "vector_mm": vector_mm.tolist(),
                "std_mm": [stds.get(f"tool.{name}.{axis}") for axis in "xyz"],
            }
            for name, vector_mm in self.tools_mm.items()
        }

    @property
    def artefacts_agree(self) -> bool:
        """Whether no certificate is contradicted and no artefact lost many poses."""
        return not (self.contradictions or self.lost_poses)

    @property
    def moving(self) -> dict[str, float]:
        """Name what the last step would have changed, in plausible deviations."""
        parameters = self.adjustment.network.parameters
        step = self.adjustment.last_step / parameters.free_tolerances
        return parameters.named(step) if len(step) else {}
