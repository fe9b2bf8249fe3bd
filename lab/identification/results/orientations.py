"""Measured orientations in the result of an identification."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.lab.adjustment import Adjustment
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.identification.wrong_orientations import WrongOrientation
from traverse.lab.report.plain_values import picked, plain_values


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
        """Of all."""
        return rms_rad(self.errors_rad)

    @property
    def values(self) -> dict[str, Any]:
        """The plain values of `identification.json`."""
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
