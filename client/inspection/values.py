"""Results of an inspection, as reports have them."""

from dataclasses import dataclass

from traverse.kinematics.features.figures import Conformity


@dataclass(frozen=True, slots=True)
class FigureResult:
    """A figure of a feature or relation.

    Attributes:
        value: in `unit`, mm or deg.
        expanded: U (k = 2); None where it is not known.
        nominal, lower, upper: of its tolerance, or None.
        conformity: by ISO 14253-1; None without a tolerance.
    """

    name: str
    unit: str
    value: float
    expanded: float | None
    nominal: float | None = None
    lower: float | None = None
    upper: float | None = None
    conformity: Conformity | None = None


@dataclass(frozen=True, slots=True)
class ScanPart:
    """Samples of a scan that came for one feature.

    Attributes:
        used: those that count as touches.
        lost: dropped by the daemon, or lost between device and daemon, between them.
        in_doubt: of all of them, also of those that do not count.
    """

    session: str
    scan: str
    used: int = 0
    samples: int = 0
    lost: int = 0
    in_doubt: int = 0

    @property
    def words(self) -> str:
        words = f"scan {self.scan}: {self.used} of {self.samples:,} samples"
        words += f", {self.lost:,} lost" if self.lost else ""
        return words + (f", {self.in_doubt:,} in doubt" if self.in_doubt else "")


@dataclass(frozen=True, slots=True)
class TouchResult:
    """A touch of a feature, or a sample of a scan.

    Attributes:
        seq: of a sample the number in its scan.
        centre_mm: of the ball, in the inspection's system.
        distance_mm: from the fitted element; None of elements without a fit.
        scan: that it is a sample of; empty of a touch.
    """

    id: str
    seq: int
    centre_mm: tuple[float, ...]
    distance_mm: float | None
    doubts: tuple[str, ...]
    scan: str = ""


@dataclass(frozen=True, slots=True)
class FeatureResult:
    """A feature or relation.

    Attributes:
        kind: of the element or relation.
        of: the names that a relation is made of.
        problem: why there are no figures; empty where there are.
        scans: that touches are samples of.
        direction: unit vector of axis or normal; None without one.
    """

    name: str
    kind: str
    side: str = ""
    of: tuple[str, ...] = ()
    problem: str = ""
    figures: tuple[FigureResult, ...] = ()
    touches: tuple[TouchResult, ...] = ()
    scans: tuple[ScanPart, ...] = ()
    place_mm: tuple[float, ...] | None = None
    direction: tuple[float, ...] | None = None


@dataclass(frozen=True, slots=True)
class Inspection:
    """Results of a part.

    Attributes:
        arm, model: of the points: name, and digest of the arm file.
        system: "part" where all points have coordinates of one alignment, else "arm".
        last_ns: time of the last point [UTC]; 0 without points.
        uncertainty_unknown: why there is no U; empty where there is.
        left_out: errors that U leaves out, with the remedy; figures that depend on
            them are not judged.
    """

    part: str
    serial: str
    operator: str
    arm: str
    model: str
    system: str
    tip_mm: float
    last_ns: int
    uncertainty_unknown: str
    left_out: tuple[str, ...]
    features: tuple[FeatureResult, ...]

    @property
    def conformity(self) -> Conformity | None:
        """The worst decision on a figure; None without tolerances."""
        decisions = {
            figure.conformity
            for feature in self.features
            for figure in feature.figures
            if figure.conformity is not None
        }
        order: tuple[Conformity, ...] = (
            *("not conforming", "not judged", "undecided", "conforming"),
        )
        return next((decision for decision in order if decision in decisions), None)
