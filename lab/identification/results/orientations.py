"""Measured orientations: those that contradict the rest, and what they result in.

A pose is tested as a whole. Where it is excluded although its position alone agrees
with the others, its orientation is taken out instead, and the pose takes part again.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.lab.adjustment import Adjustment, ArmValues, IteratedAdjustment, Network
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.report.quantities import picked, plain_values

_MOST_ROUNDS = 6
# No arm is so far from its file, in the median, and an inverse rotation agrees better.
_LARGE_RAD = 0.3
_BETTER = 0.3


@dataclass(frozen=True, slots=True)
class WrongOrientation:
    """An orientation that took no part: the line of its pose, and its |w|."""

    line: int
    w: float


@dataclass(frozen=True, slots=True)
class Mounting:
    """How the instrument's probe is mounted on the last body, in the base posture.

    Attributes:
        quaternion: w, x, y, z of the rotation from the probe to the arm's frame.
        std_rad: Of small turns about the arm's x, y, z; None where it was held.
    """

    quaternion: tuple[float, ...]
    std_rad: tuple[float | None, ...]


@dataclass(frozen=True, slots=True, eq=False)
class OrientationResult:
    """Result for measured orientations.

    Attributes:
        errors_rad: Small rotation vectors from what was measured to the arm as
            identified, in its frame; NaN without a measurement, (n_poses, 3).
        used: Which took part, (n_poses,).
        rms_before_rad: Root mean square of their components with the arm as given.
        noise_rad: Standard deviation about each axis that was used.
        sigma0: Of `positions`, and of `orientations` beyond what these say; None where
            there is no redundancy.
        mountings: By `probe`, or the names of tools.
        excluded: Without the positions of their poses.
    """

    errors_rad: Floats
    used: Booleans
    rms_before_rad: float
    noise_rad: float
    sigma0: Mapping[str, float | None]
    mountings: Mapping[str, Mounting]
    excluded: tuple[WrongOrientation, ...]

    @property
    def n_measured(self) -> int:
        """How many there are, whether they took part or not."""
        return int(np.count_nonzero(np.isfinite(self.errors_rad[:, 0])))

    @property
    def rms_after_rad(self) -> float:
        """Root mean square of the components of those that took part."""
        return rms_rad(self.errors_rad[self.used])

    @property
    def rms_all_rad(self) -> float:
        return rms_rad(self.errors_rad)

    @property
    def values(self) -> dict[str, Any]:
        return {
            "n": int(np.count_nonzero(self.used)),
            "n_all": self.n_measured,
            "rms_rad": {"before": self.rms_before_rad, "after": self.rms_after_rad},
            "rms_all_rad": self.rms_all_rad,
            "noise_rad": self.noise_rad,
            "sigma0": dict(self.sigma0),
            "mountings": plain_values(self.mountings),
            "excluded": [picked(entry, "line", "w") for entry in self.excluded],
        }


def orientation_result(
    adjustment: Adjustment,
    campaign: Campaign,
    *,
    used: Booleans,
    rms_before_rad: float,
    squares_of_parts: Floats,
    stds: Mapping[str, float],
    excluded: tuple[WrongOrientation, ...],
) -> OrientationResult | None:
    """Put together what an adjustment says about the orientations of a campaign.

    Args:
        adjustment: The last one.
        campaign: With all orientations.
        used: Which took part, (n_poses,).
        rms_before_rad: With the arm as given.
        squares_of_parts: Sums of squares of positions, and of orientations beyond what
            these say, and below them their redundancies, (2, 2).
        stds: Of the free parameters, by name.
        excluded: What was taken out.

    Returns:
        None where the campaign has no orientations.
    """
    network, state = adjustment.network, adjustment.state
    if not network.parameters.mounted:
        return None
    return OrientationResult(
        errors_rad=network.orientation_errors_of(state, campaign),
        used=used,
        rms_before_rad=rms_before_rad,
        noise_rad=network.noise.orientation_rad,
        sigma0=_sigma0_of_parts(squares_of_parts),
        mountings=_mountings(adjustment, stds),
        excluded=excluded,
    )


def rms_rad(errors_rad: Floats) -> float:
    """Compute the root mean square of known components; 0 without any."""
    known = errors_rad[np.isfinite(errors_rad)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else 0.0


def orientation_sizes(errors_rad: Floats) -> Floats:
    """Compute by which angles orientations are off, NaN without one, (n,)."""
    halves = np.minimum(0.5 * np.linalg.norm(errors_rad, axis=1), 1.0)
    sizes: Floats = 2.0 * np.arcsin(halves)
    return sizes


def _sigma0_of_parts(squares_of_parts: Floats) -> dict[str, float | None]:
    """Split sigma0 into that of positions and that of orientations."""
    return {
        name: float(np.sqrt(squares / redundancy)) if redundancy > 1e-6 else None
        for name, (squares, redundancy) in zip(
            ("positions", "orientations"), squares_of_parts.T.tolist(), strict=True
        )
    }


def _mountings(
    adjustment: Adjustment, stds: Mapping[str, float]
) -> dict[str, Mounting]:
    """Put mountings together, with the standard deviations by parameters' names."""
    network, state = adjustment.network, adjustment.state
    names = [tool.name for tool in network.campaign.tools]
    mountings = {}
    for tool, quaternion in zip(
        network.parameters.mounted, state.arm.mountings.tolist(), strict=True
    ):
        key = f"tool.{names[tool - 1]}.mounting" if tool else "probe.mounting"
        mountings[names[tool - 1] if tool else "probe"] = Mounting(
            tuple(quaternion), tuple(stds.get(f"{key}.{axis}") for axis in "xyz")
        )
    return mountings


def without_wrong_orientations(
    campaign: Campaign,
    run: IteratedAdjustment,
    adjusted: Callable[[Campaign], IteratedAdjustment],
) -> tuple[Campaign, IteratedAdjustment, tuple[WrongOrientation, ...]]:
    """Take out orientations that contradict the rest, until none does.

    Returns the campaign without them, its adjustment, and what was taken out, by line.
    """
    excluded: list[WrongOrientation] = []
    for _ in range(_MOST_ROUNDS):
        wrong = run.contradicted_by_orientation()
        if not np.any(wrong):
            break
        lines, w = campaign.poses.lines[wrong], run.statistics.w_orientation[wrong]
        excluded += map(WrongOrientation, lines.tolist(), w.tolist())
        campaign = campaign.without_orientations(wrong)
        run = adjusted(campaign)
    return campaign, run, tuple(sorted(excluded, key=lambda entry: entry.line))


def are_inverse(network: Network, arm: ArmValues, unknowns: Sequence[Floats]) -> bool:
    """Return whether orientations contradict an arm, and their inverses do not.

    The unknowns are of each station.
    """
    medians_rad = []
    for signs in (np.ones(4), np.array([1.0, -1.0, -1.0, -1.0])):
        turned = tuple(
            replace(station, touches=replace(touches, orientations=signs * seen))
            if (seen := touches.orientations) is not None
            else station
            for station in network.stations
            for touches in [station.touches]
        )
        of_inverse = replace(network, stations=turned)
        mounted = replace(arm, mountings=of_inverse.fitted_mountings(arm, unknowns))
        errors_rad = [
            network.orientation_errors_rad(station, mounted, of_station)
            for station, of_station in zip(turned, unknowns, strict=True)
        ]
        sizes_rad = np.linalg.norm(np.concatenate(errors_rad), axis=1)
        medians_rad.append(float(np.nanmedian(sizes_rad)))
    as_given, turned_round = medians_rad
    return as_given > _LARGE_RAD and turned_round < _BETTER * as_given
