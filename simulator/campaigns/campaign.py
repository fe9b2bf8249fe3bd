"""A simulated campaign in memory, and its truth."""

from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Effect
from traverse.simulator.arm.physics import probe_pose
from traverse.simulator.arm.truth import TrueArm
from traverse.simulator.campaigns.pose_set import PlacedArtefact
from traverse.simulator.campaigns.spec import BlunderKind
from traverse.simulator.effects import Fault

Names = NDArray[np.str_]
FIRST_LINE = 2  # of poses.csv with a pose; the header is line 1


def _freeze(values: "Campaign | Truth") -> None:
    for field in fields(values):
        array = getattr(values, field.name)
        if isinstance(array, np.ndarray):
            array.setflags(write=False)


@dataclass(frozen=True, slots=True)
class StatedArtefact:
    """An artefact as a campaign states it.

    The table has the further keys of `[[artefacts]]`, ready to be written.
    """

    id: str
    kind: str
    table: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Campaign:
    """Contents of the files of a campaign, by column; arrays are read-only.

    Attributes:
        joints: names, from the base outwards.
        encoder_rad: a-priori standard deviation, or None.
        contact_mm: a-priori standard deviation, or None.
        orientation_rad: a-priori standard deviation, or None.
        start_utc: ISO 8601, or None.
        time_s: (n,)
        artefact: (n,) ids.
        feature: (n,) names, empty if there is only one.
        readings_rad: (n, n_joints)
        temperature_c: (n,), None if there is no such column; likewise the others.
        approach: (n, n_joints) -1 or +1.
        speed_rad_s: (n, n_joints)
        direction: (n, 3) unit vectors; rows of NaN where empty.
        force_n: (n,)
        length_mm: (n,) readings of draw wires; NaN for other artefacts.
        orientation: (n, 4) unit quaternions w, x, y, z of the instrument's probe in
            the artefact's system; rows of NaN where not measured.
    """

    joints: tuple[str, ...]
    artefacts: tuple[StatedArtefact, ...]
    encoder_rad: float | None
    contact_mm: float | None
    start_utc: str | None
    time_s: Floats
    artefact: Names
    feature: Names
    readings_rad: Floats
    temperature_c: Floats | None
    approach: NDArray[np.int8] | None
    speed_rad_s: Floats | None
    direction: Floats | None
    force_n: Floats | None
    length_mm: Floats | None = None
    orientation: Floats | None = None
    orientation_rad: float | None = None

    def __post_init__(self) -> None:
        _freeze(self)

    @property
    def n_poses(self) -> int:
        return len(self.time_s)


@dataclass(frozen=True, slots=True)
class Blunder:
    """A blunder in one pose.

    Attributes:
        row: of the arrays, from 0; its line in poses.csv is row + 2.
        size: displacement (mm), jump of the encoder or error of orientation (rad);
            NaN for a wrong label.
        what: the joint that jumped, or artefact/feature that were really touched.
    """

    row: int
    kind: BlunderKind
    size: float
    unit: Literal["mm", "rad", ""]
    what: str

    @property
    def line(self) -> int:
        return self.row + FIRST_LINE


@dataclass(frozen=True, slots=True)
class Truth:
    """True values that the campaign does not state; arrays are read-only.

    Attributes:
        turns_rad: (n, n_joints) true turns from the base posture at the contact.
        contacts_mm: (n, 3) centre of a ball of the arm file's radius, on a stiff
            stylus: the right result of corrected readings.
        contact_noise_mm: (n, 3) displacement of the ball from the exact contact,
            blunders included.
        encoder_noise_rad: (n, n_joints) added to the true readings before rounding,
            blunders included.
        blunders: in the order of rows.
        effects: played ones, with vectors for the true axes.
        faults: further ones, which no arm file can name.
        mounting: (3, 3) its columns are the axes of the instrument's probe in the last
            body, in the base posture; None without orientations.
    """

    arm: TrueArm
    artefacts: tuple[PlacedArtefact, ...]
    turns_rad: Floats
    contacts_mm: Floats
    contact_noise_mm: Floats
    encoder_noise_rad: Floats
    blunders: tuple[Blunder, ...]
    effects: tuple[Effect, ...]
    faults: tuple[Fault, ...]
    mounting: Floats | None = None

    def __post_init__(self) -> None:
        _freeze(self)

    def centres_mm(self, readings_rad: Floats) -> Floats:
        """Return true ball centres (n, 3) at readings (n, n_joints) without effects.

        Distances between them do not depend on datum or base posture.
        """
        turns_rad = (readings_rad - self.arm.zeros_rad) @ self.arm.gearing.T
        return probe_pose(self.arm.mechanism, turns_rad)[0]


@dataclass(frozen=True, slots=True)
class SimulatedCampaign:
    """A campaign and its truth."""

    campaign: Campaign
    truth: Truth
