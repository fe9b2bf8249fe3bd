"""Encoders that show the wrong angle.

A disc's error belongs to the line under the head, so to what is shown, not to the
true turn: a reading is found where both agree. The last six are faults
that no arm file can name; a diagnosis should say that it knows no name. Their angles
are true ones: reading minus errors.
"""

from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.simulator.effects.fault import JointState, ReadingFault


@dataclass(frozen=True, slots=True)
class WavyDisc(ReadingFault):
    """The disc is eccentric, tilted, oval: so many waves a turn."""

    joints: slice
    order: int
    cos_rad: float
    sin_rad: float

    def errors_rad(self, seen: JointState) -> Floats:
        """A wave of the reading, as one sine with its phase."""
        size = np.hypot(self.cos_rad, self.sin_rad)
        phase = np.arctan2(self.cos_rad, self.sin_rad)
        waves: Floats = size * np.sin(
            self.order * seen.readings_rad[:, self.joints] + phase
        )
        return waves


@dataclass(frozen=True, slots=True)
class ToothedDrive(ReadingFault):
    """Teeth that are not alike: the drive leads and lags with every one."""

    joints: slice
    cycles: float
    cos_rad: float
    sin_rad: float

    def errors_rad(self, seen: JointState) -> Floats:
        """A phasor that turns so many times as fast as what is shown."""
        drive_turns = self.cycles * seen.readings_rad[:, self.joints] / (2.0 * np.pi)
        phasor = np.exp(2j * np.pi * np.mod(drive_turns, 1.0))
        found: Floats = np.real(complex(self.cos_rad, -self.sin_rad) * phasor)
        return found


@dataclass(frozen=True, slots=True)
class LongTape(ReadingFault):
    """A graduation with too many lines a radian."""

    joints: slice
    scale_ppm: float

    def errors_rad(self, seen: JointState) -> Floats:
        """Grows with what is shown since the base posture."""
        shown_rad = (
            seen.readings_rad[:, self.joints] - seen.build.zeros_rad[self.joints]
        )
        return 1e-6 * self.scale_ppm * shown_rad


@dataclass(frozen=True, slots=True)
class WarmHead(ReadingFault):
    """The head moves with the temperature."""

    joints: slice
    rate_rad_c: float
    reference_c: float

    def errors_rad(self, seen: JointState) -> Floats:
        """Nothing at the reference temperature."""
        warmer_c = seen.around.temperature_c - self.reference_c
        return self.rate_rad_c * warmer_c[:, None]


@dataclass(frozen=True, slots=True)
class CreepingZero(ReadingFault):
    """The zero creeps continuously."""

    joints: slice
    rate_rad_s: float
    epoch_utc_s: float

    def errors_rad(self, seen: JointState) -> Floats:
        """Nothing at the epoch."""
        return self.rate_rad_s * seen.around.since_s(self.epoch_utc_s)[:, None]


@dataclass(frozen=True, slots=True)
class LostCounts(ReadingFault):
    """Counts are lost at a moment and never found again."""

    joints: slice
    step_rad: float
    at_s: float
    epoch_utc_s: float

    def errors_rad(self, seen: JointState) -> Floats:
        """Nothing before."""
        since_s = seen.around.since_s(self.epoch_utc_s)
        return np.where(since_s >= self.at_s, self.step_rad, 0.0)[:, None]


@dataclass(frozen=True, slots=True)
class LateReading(ReadingFault):
    """Delay: the reading is the turn of a moment ago."""

    joints: slice
    latency_s: float

    def errors_rad(self, seen: JointState) -> Floats:
        """A joint that moves forwards is shown too far back."""
        return -self.latency_s * seen.around.speed_rad_s[:, self.joints]


@dataclass(frozen=True, slots=True)
class Play(ReadingFault):
    """The encoder runs ahead of the joint in the sense of the motion."""

    joints: slice
    half_width_rad: float

    def errors_rad(self, seen: JointState) -> Floats:
        """Two-valued."""
        return self.half_width_rad * seen.around.approach[:, self.joints]


OF_JOINT = ("_temperature_c", "_speed_rad_s", "_approach", "_rad")
OF_ARM = ("time_s", "temperature_c", "force_n")


@dataclass(frozen=True, slots=True)
class CurvedError(ReadingFault):
    """A natural cubic spline, level beyond its outer knots.

    Attributes:
        joints: Whose reading is spoilt.
        column: Of a campaign, without the name of the joint.
        of_joint: The joint of the covariate; -1 for one of the whole arm.
        knots: (m,) increasing.
        values_rad: (m,) there.
        slopes: (m,) there.
    """

    joints: slice
    column: str
    of_joint: int
    knots: Floats
    values_rad: Floats
    slopes: Floats

    def errors_rad(self, seen: JointState) -> Floats:
        """Cubic Hermite pieces."""
        at = np.clip(self._covariate(seen), self.knots[0], self.knots[-1])
        left = np.searchsorted(self.knots, at, side="right") - 1
        left = np.clip(left, 0, len(self.knots) - 2)
        width = np.diff(self.knots)[left]
        u = (at - self.knots[left]) / width
        rise = self.values_rad[left + 1] - self.values_rad[left]
        first, last = self.slopes[left] * width, self.slopes[left + 1] * width
        curve = self.values_rad[left] + u * (
            first
            + u * (3.0 * rise - 2.0 * first - last + u * (first + last - 2 * rise))
        )
        return curve[:, None]

    def _covariate(self, seen: JointState) -> Floats:
        around, k = seen.around, self.of_joint
        columns: dict[str, Floats] = {
            "_rad": seen.readings_rad[:, k],
            "_speed_rad_s": around.speed_rad_s[:, k],
            "_approach": around.approach[:, k],
            "time_s": around.time_s,
            "force_n": around.force_n,
        }
        return columns.get(self.column, around.temperature_c)


def natural_slopes(knots: Floats, values: Floats) -> Floats:
    """Slopes (m,) of the natural cubic spline: no bending at both ends.

    Second derivatives continuous: s_(i-1)/h_(i-1) + 2 s_i (1/h_(i-1) + 1/h_i) +
    s_(i+1)/h_i = 3 (c_(i-1)/h_(i-1) + c_i/h_i), c the slopes of the chords; at the
    ends 2 s_0 + s_1 = 3 c_0.
    """
    weights = 1.0 / np.diff(knots)
    pulls = 3.0 * weights**2 * np.diff(values)
    system, right = np.zeros((len(knots), len(knots))), np.zeros(len(knots))
    for i, weight in enumerate(weights.tolist()):
        system[i : i + 2, i : i + 2] += weight * np.array([[2.0, 1.0], [1.0, 2.0]])
    right[:-1] += pulls
    right[1:] += pulls
    return np.asarray(np.linalg.solve(system, right), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Bump(ReadingFault):
    """Damaged lines: a smooth hill over a range of angles, nothing elsewhere.

    Attributes:
        joints: Of one encoder.
        middle_rad: Of the hill.
        half_width_rad: To where it ends.
        height_rad: Of the hill.
    """

    joints: slice
    middle_rad: float
    half_width_rad: float
    height_rad: float

    def errors_rad(self, seen: JointState) -> Floats:
        """A raised cosine."""
        off = (_angles_rad(seen, self.joints) - self.middle_rad) / self.half_width_rad
        hill = 0.5 * (1.0 + np.cos(np.pi * np.clip(off, -1.0, 1.0)))
        return self.height_rad * hill


@dataclass(frozen=True, slots=True)
class JumpInAngle(ReadingFault):
    """Lines are missing: beyond an angle all readings are off."""

    joints: slice
    at_rad: float
    step_rad: float

    def errors_rad(self, seen: JointState) -> Floats:
        """Nothing below the angle."""
        beyond = _angles_rad(seen, self.joints) >= self.at_rad
        return np.where(beyond, self.step_rad, 0.0)


@dataclass(frozen=True, slots=True)
class CubicError(ReadingFault):
    """An error that grows with the third power of the turn."""

    joints: slice
    rate_per_rad2: float

    def errors_rad(self, seen: JointState) -> Floats:
        """Of the turn from the base posture."""
        cubes: Floats = seen.turns_rad[:, self.joints] ** 3
        return self.rate_per_rad2 * cubes


@dataclass(frozen=True, slots=True)
class Sawtooth(ReadingFault):
    """A gear or interpolator that creeps and snaps back, so many times a turn."""

    joints: slice
    teeth: int
    height_rad: float

    def errors_rad(self, seen: JointState) -> Floats:
        """From minus half to plus half of the height."""
        cycles = self.teeth * _angles_rad(seen, self.joints) / (2.0 * np.pi)
        return self.height_rad * (cycles % 1.0 - 0.5)


@dataclass(frozen=True, slots=True)
class CrossCoupling(ReadingFault):
    """One joint's reading follows another joint's angle, for example by a cable.

    Attributes:
        joints: Of the encoder that is spoilt.
        other: The joint that it follows.
        height_rad: Largest error.
        order: Periods a turn of the other joint.
        phase_rad: Of the wave.
    """

    joints: slice
    other: int
    height_rad: float
    order: int = 1
    phase_rad: float = 0.0

    def errors_rad(self, seen: JointState) -> Floats:
        """A wave of the other joint's angle."""
        angles_rad = _angles_rad(seen, slice(self.other, self.other + 1))
        waves: Floats = np.sin(self.order * angles_rad + self.phase_rad)
        return self.height_rad * waves


@dataclass(frozen=True, slots=True)
class SquareOfTemperature(ReadingFault):
    """An error that grows with the square of the departure from a temperature."""

    joints: slice
    rate_rad_c2: float
    reference_c: float = 20.0

    def errors_rad(self, seen: JointState) -> Floats:
        """Equal for warmer and colder."""
        warmer_c = seen.around.temperature_c - self.reference_c
        squares: Floats = warmer_c[:, None] ** 2
        return self.rate_rad_c2 * squares


def _angles_rad(seen: JointState, joints: slice) -> Floats:
    """True angles on the disc, (n, n_chosen)."""
    angles: Floats = seen.turns_rad[:, joints] + seen.build.zeros_rad[joints]
    return angles
