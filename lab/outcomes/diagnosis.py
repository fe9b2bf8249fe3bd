"""The outcome of a diagnosis, as `diagnosis.json` has it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

from traverse.kinematics.arm_file.arm import Effect
from traverse.lab.outcomes.candidate import BankName, Candidate
from traverse.lab.report.quantities import HIDDEN, INLINED, OMITTED, picked
from traverse.lab.statistics.outlier_clusters import Cluster

Status = Literal["named", "tentative", "unknown"]
Verdict = Literal["clean", "named", "tentative", "unexplained", "unknown"]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A key of an effect as estimated, with its standard deviation, of the same shape.

    A number, or a vector's components, or a spline's values.
    """

    value: float | tuple[float, ...]
    std: float | tuple[float, ...]
    unit: str


@dataclass(frozen=True, slots=True)
class Alternative:
    """Another name that the data cannot exclude.

    Attributes:
        log_bayes_factor: Natural logarithm, against nothing missing.
        correlation: Of this finding with the other block, 0 to 1.
        alias: No poses of this kind can separate the two.
    """

    candidate: Candidate = field(metadata=INLINED)
    log_bayes_factor: float
    correlation: float
    alias: bool

    @property
    def changes_scale(self) -> bool:
        """Whether it is a wrong length that the arm takes up as its scale."""
        is_shared = self.alias or self.candidate.is_of_several
        return self.candidate.is_length and is_shared


@dataclass(frozen=True, slots=True)
class HoldoutResult:
    """How well a model predicts held-out poses.

    Attributes:
        rms_mm: Of their misclosures.
        chi2: S, their mean square over the predictive covariance.
        chi2_std: The standard deviation of S by chance, by the equations of these poses
            and the redundancy of the fit.
        mean_distance_mm: To known points, if any.
        largest_mm: The largest misclosure of a pose; NaN without poses.
        without_blunders: The same without poses that contradict their neighbours;
            None: there are none.
    """

    rms_mm: float
    chi2: float
    n: int
    mean_distance_mm: float | None
    n_poses: int = 0
    largest_mm: float = float("nan")
    chi2_std: float = float("nan")
    without_blunders: "HoldoutResult | None" = None


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldoutMisfit:
    """Poses kept aside that contradict a model which explains all others.

    Attributes:
        artefact: Where they contradict it most.
        figures: Of all poses kept aside but the blunders.
        is_gross: The model predicts them no better than to a hundredth of the
            measured volume, or of a tenth of the reach where that is more.
        log_p: Natural logarithm of the probability of such an S by chance.
        n_contradicting: Poses that contradict the model one by one.
    """

    artefact: str
    figures: HoldoutResult
    is_gross: bool
    log_p: float
    n_contradicting: int
    n_contradicting_there: int
    n_poses_there: int


# Smaller p-values are no numbers any more.
_LEAST_LOG10_P = -300.0


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Term:
    """Something that the model lacked.

    Attributes:
        candidate: The name; of an unknown one, where the discrepancy lives.
        harmonic: Periods a turn of an unknown, periodic discrepancy, or None.
        parameters: Estimates by key of the effect.
        log_bayes_factor: Natural logarithm, against the model without the term.
        log10_p: Of its test in the model with all other terms.
        alternatives: What else it may be, the best first.
        separate_by: The experiment that would separate them, in words.
        accepted: Whether it is in the adapted arm.
        in_arm_file: Whether the file holds it, too.
        oversized: Whether no machine has as much of it: then it has another cause.
        negative: Whether it is a compliance that yields against the weight or the
            force: then it is something else that follows these.
        helps: Whether poses kept aside are predicted no worse with it.
        effect: As an entry of the arm file; None: a curve that has no form there.
        cluster: The cluster of left-out poses, if it reports one.
        misfit: Poses kept aside that contradict the model, if it reports these.
    """

    DERIVED: ClassVar = ("p_value", "seen", "poses", "held_out")

    candidate: Candidate = field(metadata=INLINED)
    status: Status
    harmonic: int | None = field(default=None, metadata=OMITTED)
    parameters: Mapping[str, Estimate] = field(default_factory=dict)
    log_bayes_factor: float
    log10_p: float
    alternatives: tuple[Alternative, ...] = ()
    separate_by: str = ""
    accepted: bool = False
    in_arm_file: bool = False
    oversized: bool = False
    negative: bool = False
    helps: bool = True
    effect: Effect | None = field(default=None, metadata=HIDDEN)
    cluster: Cluster | None = field(default=None, metadata=HIDDEN)
    misfit: HoldoutMisfit | None = field(default=None, metadata=HIDDEN)

    @property
    def p_value(self) -> float:
        return 0.0 if self.log10_p < _LEAST_LOG10_P else 10.0**self.log10_p

    @property
    def seen(self) -> Mapping[str, float] | None:
        """Range of the covariate that a curve was seen in; None: it is no curve."""
        knots = None if self.effect is None else self.effect.values.get("knots")
        return None if knots is None else {"low": knots[0], "high": knots[-1]}

    @property
    def poses(self) -> Mapping[str, Any] | None:
        """Where left-out poses lie together, if it reports that."""
        if self.cluster is None:
            return None
        return picked(self.cluster, "low", "high", excluded="n_excluded", all="n_poses")

    @property
    def held_out(self) -> Mapping[str, Any] | None:
        """How poses kept aside contradict the model, if it reports that."""
        if self.misfit is None:
            return None
        return picked(self.misfit.figures, "chi2", "rms_mm", all="n_poses") | picked(
            self.misfit,
            contradicting="n_contradicting",
            contradicting_there="n_contradicting_there",
            all_there="n_poses_there",
        )


@dataclass(frozen=True, slots=True)
class Size:
    """A number with its unit."""

    value: float
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Detectable:
    """Minimal detectable size of an effect.

    Attributes:
        key: Key in the arm file to which the size belongs.
        minimum: In its worst direction; None: it cannot be seen at all.
        best: In its best direction.
        probe_mm: What the undetected minimum does to the probe (root mean square).
        why: Reason where it is undetectable.
    """

    candidate: Candidate = field(metadata=INLINED)
    key: str
    minimum: Size | None = None
    best: Size | None = None
    probe_mm: float = 0.0
    why: str | None = None


@dataclass(frozen=True, slots=True)
class BankRemainder:
    """The largest finding of a bank when nothing more was added, and what it needed."""

    candidate: Candidate = field(metadata=INLINED)
    bank: BankName
    log10_p: float
    threshold_log10_p: float


@dataclass(frozen=True, slots=True)
class BeforeAfter:
    """A figure without any terms, and with those that count."""

    before: float | None
    after: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Gap:
    """How two models predict poses kept aside.

    Attributes:
        held_out_chi2_std: The standard deviation of the latter by chance.
        closed: Part of the gap that is closed; None: too little to say.
        left_out: Lines that were left out.
        without_blunders: The same without poses that contradict their neighbours.
        with_all_terms: And with those terms, too, that are not written.
    """

    held_out_rms_mm: BeforeAfter
    held_out_chi2: BeforeAfter
    held_out_chi2_std: float
    held_out_largest_mm: BeforeAfter
    closed: float | None
    n: int
    n_poses: int
    held_out_mean_distance_mm: BeforeAfter | None = field(
        default=None, metadata=OMITTED
    )
    left_out: Sequence[Mapping[str, int]] | None = field(default=None, metadata=OMITTED)
    without_blunders: "Gap | None" = field(default=None, metadata=OMITTED)
    with_all_terms: "Gap | None" = field(default=None, metadata=OMITTED)


@dataclass(frozen=True, slots=True)
class LedgerLine:
    """Figures with an effect, or none, and all before it."""

    DERIVED: ClassVar = ("held_out_rms_mm", "held_out_chi2", "without_blunders")

    effect: str | None
    sigma0: float
    held_out: HoldoutResult = field(metadata=HIDDEN)

    @property
    def held_out_rms_mm(self) -> float:
        return self.held_out.rms_mm

    @property
    def held_out_chi2(self) -> float:
        return self.held_out.chi2

    @property
    def without_blunders(self) -> Mapping[str, float] | None:
        figures = self.held_out.without_blunders
        names = {"held_out_rms_mm": "rms_mm", "held_out_chi2": "chi2"}
        return None if figures is None else picked(figures, **names)


@dataclass(frozen=True, slots=True)
class LeftOutPose:
    """A pose that took no part in choosing, or in the last estimates."""

    line: int
    choosing: bool
    final: bool
    w: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DiagnosisFigures:
    """What a diagnosis found, as `diagnosis.json` has it.

    Attributes:
        visible: How many effects of the library the poses could have shown, `n` `of`.
        times_stated_noise: Mean square of the poses kept aside where it is beyond.
    """

    verdict: Verdict
    visible: Mapping[str, int]
    terms: tuple[Term, ...]
    sigma0: BeforeAfter
    gap: Gap
    excluded: tuple[LeftOutPose, ...]
    orientations: Mapping[str, Any]
    detectable: tuple[Detectable, ...]
    ledger: tuple[LedgerLine, ...]
    vetoed: bool
    times_stated_noise: float | None
    identified_anew: bool
    wrong_signs: tuple[str, ...]
    zero_offsets_rad: Mapping[str, float]
    leftovers: tuple[BankRemainder, ...]
    noise: Mapping[str, Any]
    seed: int
    holdout_by: str
    family: Mapping[str, Any] | None = field(default=None, metadata=OMITTED)
    mass_distribution: Mapping[str, Any] | None = field(default=None, metadata=OMITTED)
    tools: Mapping[str, Any] | None = field(default=None, metadata=OMITTED)
