"""Measured orientations in the result of an identification."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.lab.adjustment.equations import orientation_errors
from traverse.lab.adjustment.noise import VarianceSums
from traverse.lab.adjustment.parameters import tool_key
from traverse.lab.adjustment.problem import Network, State, known_stations
from traverse.lab.adjustment.solve import Adjustment
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
        return _rms(self.errors_rad[self.used])

    @property
    def rms_all_rad(self) -> float:
        """Of all."""
        return _rms(self.errors_rad)

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
    radius_mm: float,
    *,
    used: Booleans,
    before: State,
    sums: VarianceSums,
    stds: Mapping[str, float],
    excluded: tuple[WrongOrientation, ...],
) -> OrientationResult | None:
    """Put together what an adjustment says about the orientations of a campaign.

    Args:
        adjustment: The last one.
        campaign: With all orientations.
        radius_mm: Of the probe's ball.
        used: Which took part, (n_poses,).
        before: With the arm as given.
        sums: Of the residuals.
        stds: Of the free parameters, by name.
        excluded: What was taken out.

    Returns:
        None where the campaign has no orientations.
    """
    network, state = adjustment.network, adjustment.state
    if not network.parameters.mounted:
        return None
    return OrientationResult(
        errors_rad=_errors(network, state, campaign, radius_mm),
        used=used,
        rms_before_rad=_rms(_errors(network, before, campaign, radius_mm)),
        noise_rad=network.noise.orientation_rad,
        sigma0=_sigma0_of_parts(sums),
        mountings=_mountings(network, state, stds),
        excluded=excluded,
    )


def _rms(errors_rad: Floats) -> float:
    """Compute the root mean square of known components; 0 without any."""
    known = errors_rad[np.isfinite(errors_rad)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else 0.0


def orientation_sizes(errors_rad: Floats) -> Floats:
    """Compute by which angles orientations are off, NaN without one, (n,)."""
    halves = np.minimum(0.5 * np.linalg.norm(errors_rad, axis=1), 1.0)
    sizes: Floats = 2.0 * np.arcsin(halves)
    return sizes


def _errors(
    network: Network, state: State, campaign: Campaign, radius_mm: float
) -> Floats:
    """Compare all orientations of a campaign with a state, (n_poses, 3) [rad].

    Those of artefacts without a place have none.
    """
    errors_rad = np.full((len(campaign.poses), 3), np.nan)
    every = np.ones(len(errors_rad), dtype=np.bool_)
    known, unknowns = known_stations(network, state, campaign, radius_mm, every)
    whole = network.on(campaign)
    for station, own in zip(known, unknowns, strict=True):
        errors_rad[station.poses] = orientation_errors(whole, station, state.arm, own)
    return errors_rad


def _sigma0_of_parts(sums: VarianceSums) -> dict[str, float | None]:
    """Split sigma0 into that of positions and that of orientations."""
    return {
        name: float(np.sqrt(squares / redundancy)) if redundancy > 1e-6 else None
        for name, (squares, redundancy) in zip(
            ("positions", "orientations"), sums.of_parts.T.tolist(), strict=True
        )
    }


def _mountings(
    network: Network, state: State, stds: Mapping[str, float]
) -> dict[str, Mounting]:
    """Put mountings together, with the standard deviations by parameters' names."""
    names = [tool.name for tool in network.campaign.tools]
    found = {}
    for tool, quaternion in zip(
        network.parameters.mounted, state.arm.mountings.tolist(), strict=True
    ):
        key = f"{tool_key(names, tool)}.mounting"
        found[names[tool - 1] if tool else "probe"] = Mounting(
            tuple(quaternion), tuple(stds.get(f"{key}.{axis}") for axis in "xyz")
        )
    return found
