"""What an identification found, as `identification.json` has it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from traverse.arrays import Floats
from traverse.lab.report.quantities import OMITTED


@dataclass(frozen=True, slots=True)
class ParameterEstimate:
    """One free parameter.

    Attributes:
        value: Change against the design, in the design's basis.
        unit: rad, mm, or a term's own.
        controllability: Which part of what the data say about it no other parameter
            can take away, 0 to 1: 1 / (N_ii C_ii).
    """

    name: str
    value: float
    unit: str
    std: float
    controllability: float


@dataclass(frozen=True, slots=True)
class ExcludedPose:
    """A pose that contradicts the others: its line in the file, and its |w|.

    Attributes:
        part: What of it contradicts: "position", or "position and orientation".
    """

    line: int
    w: float
    part: str = "position"


@dataclass(frozen=True, slots=True)
class Weak:
    """A combination that the data determine poorly.

    Attributes:
        direction: Components by name, in units of the plausible deviations, of unit
            length together; small ones left out.
        std: Standard deviation as a part of the plausible deviation.
        probe_mm: Standard deviation that it causes at the probe: root mean square
            over the travelled ranges, at least 120 degrees a joint, rigid motion
            taken out.
        why: The likely reason and the remedy.
    """

    direction: Mapping[str, float]
    std: float
    probe_mm: float
    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ContradictedCertificate:
    """A certificate that the measurements contradict; it took no part.

    Attributes:
        length: What it certifies, such as `distance_mm`; of two radii the mean.
        sigmas: Standard deviations by which the campaign fits better without it.
        or_else: `artefact name` of others that explain the contradiction as well.
        value_mm: As measured; NaN before the last adjustment.
    """

    artefact: str
    length: str
    certified_mm: float
    value_mm: float = math.nan
    std_mm: float = math.nan
    sigmas: float
    or_else: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Suggestion:
    """A pose worth measuring.

    Attributes:
        feature: Which feature; empty where there is only one.
        angles_rad: Readings of the joints, (n_joints,).
        variance_left: Mean variance of the probe after this pose and those before it
            in the list, as a part of the present one.
    """

    artefact: str
    feature: str
    angles_rad: Floats
    variance_left: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class IdentificationFigures:
    """The figures of an identification.

    Attributes:
        excluded: Of an artefact that lost all poses none can be tested: w is null.
        contact_shift: What the contacts with all certified radii share.
        still_moving: What the last step of an adjustment that did not converge changed.
        serial_noise: What neighbouring samples of a stream share.
    """

    inputs: Mapping[str, Any]
    verdict: str
    converged: bool
    iterations: int
    sigma0: float
    redundancy: int
    global_test: Mapping[str, Any]
    rms_mm: Mapping[str, float]
    parameters: Sequence[ParameterEstimate]
    undetermined: Sequence[Mapping[str, Any]]
    weak: Sequence[Weak]
    artefacts: Mapping[str, Mapping[str, Any]]
    tools: Mapping[str, Any]
    excluded: Sequence[ExcludedPose]
    orientations: Mapping[str, Any] | None
    holdout: Mapping[str, Any] | None
    family: Mapping[str, Any] | None = field(default=None, metadata=OMITTED)
    mass_distribution: Mapping[str, Any] | None = field(default=None, metadata=OMITTED)
    alternating: Sequence[int]
    contradictions: Sequence[ContradictedCertificate]
    contact_shift: Mapping[str, Any] | None
    wrong_signs: Sequence[str]
    lost_poses: Mapping[str, Mapping[str, int]]
    clusters: Sequence[Mapping[str, Any]]
    still_moving: Mapping[str, float]
    noise: Mapping[str, Any]
    serial_noise: Mapping[str, Any] | None
    condition_number: float
    zero_offsets_rad: Floats
    coverage: Sequence[Mapping[str, Any]]
    suggestions: Sequence[Suggestion]
