"""How well an arm fits poses that took no part in its identification.

The arm is held. Places of the artefacts are taken from other poses, or, where nothing
else says it, from the judged poses themselves; then distances are somewhat too small.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from traverse.arrays import Booleans, Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.effect_table import EFFECT_KINDS, Family
from traverse.kinematics.effects.pose import pose_flags
from traverse.lab.adjustment import Options, Problem
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.poses import texts
from traverse.lab.identification.identify import identify
from traverse.lab.identification.results.orientations import (
    Mounting,
    orientation_sizes,
)
from traverse.lab.identification.results.result import Identification
from traverse.lab.report.templates import Words

WORDS = Words("identification/prediction.jinja")
_ARM = ("*.axis.?", "*.link.?", "origin.?")
# All poses count, whether they agree or not.
_PLACING = Options(
    hold=_ARM, snooping=False, coarse_start=False, n_suggestions=0
).with_noise_held
_WITH_TOOL = replace(_PLACING, free=("probe.vector.?",))


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Poses against an arm.

    Attributes:
        misclosures_mm: NaN beyond those of a surface, (n_poses, 3).
        placed_by_itself: Ids of artefacts that were placed by these very poses.
        orientation_errors_rad: Small rotation vectors from measured orientations to
            the arm's, NaN where there are none, (n_poses, 3).
    """

    campaign: Campaign
    misclosures_mm: Floats
    placed_by_itself: frozenset[str]
    orientation_errors_rad: Floats

    @property
    def distances_mm(self) -> Floats:
        """From where a seat or point is, or from a surface, (n_poses,)."""
        distances: Floats = np.sqrt(np.nansum(self.misclosures_mm**2, axis=1))
        return distances

    def figures(self, rows: Booleans | None = None) -> dict[str, Any]:
        """Sum up some poses, by default all; with the line of the worst."""
        part = slice(None) if rows is None else rows
        distances_mm = self.distances_mm[part]
        worst = int(np.argmax(distances_mm))
        return {
            **self._orientations(part),
            "n": len(distances_mm),
            "mean_mm": float(distances_mm.mean()),
            "rms_mm": float(np.sqrt(np.mean(distances_mm**2))),
            "median_mm": float(np.median(distances_mm)),
            "p95_mm": float(np.percentile(distances_mm, 95.0)),
            "largest_mm": float(distances_mm[worst]),
            "largest_line": int(self.campaign.poses.lines[part][worst]),
        }

    def _orientations(self, part: slice | Booleans) -> dict[str, Any]:
        """Sum up by which angles orientations are off; nothing without any."""
        sizes_rad = orientation_sizes(self.orientation_errors_rad[part])
        known = np.isfinite(sizes_rad)
        if not np.any(known):
            return {}
        lines, sizes_rad = self.campaign.poses.lines[part][known], sizes_rad[known]
        worst = int(np.argmax(sizes_rad))
        found_rad = {
            "mean": float(sizes_rad.mean()),
            "rms": float(np.sqrt(np.mean(sizes_rad**2))),
            "largest": float(sizes_rad[worst]),
        }
        return {
            "orientation": {
                "n": len(sizes_rad),
                **{f"{name}_rad": value for name, value in found_rad.items()},
                **{
                    f"{name}_deg": float(np.degrees(value))
                    for name, value in found_rad.items()
                },
                "largest_line": int(lines[worst]),
            }
        }

    def by_artefact(self) -> dict[str, dict[str, Any]]:
        touched = self.campaign.poses.artefacts
        return {
            artefact.id: {
                **self.figures(touched == index),
                "placed_by": "itself"
                if artefact.id in self.placed_by_itself
                else "others",
            }
            for index, artefact in enumerate(self.campaign.artefacts)
            if np.any(touched == index)
        }


def placed(campaign: Campaign, arm: Arm, *, with_tool: bool = False) -> Identification:
    """Find the places of the artefacts, by least squares over all poses.

    The arm's geometry and effects are held; with the tool, the probe's vector is found.

    Raises:
        IdentificationError: Arm and campaign do not fit together.
    """
    options = _WITH_TOOL if with_tool else _PLACING
    return identify(replace(campaign, prior=None), arm, options)


def places_of(result: Identification) -> Mapping[str, Floats]:
    """Take the states of the artefacts out of an adjustment, by their ids."""
    adjustment = result.adjustment
    return {
        station.artefact.id: unknowns
        for station, unknowns in zip(
            adjustment.network.stations, adjustment.state.unknowns, strict=True
        )
    }


def mountings_of(result: Identification) -> Mapping[str, Mounting]:
    """Take how the instrument's probes are mounted out of an adjustment."""
    return {} if result.orientations is None else result.orientations.mountings


def predict(
    campaign: Campaign,
    arm: Arm,
    places: Mapping[str, Floats],
    tools_mm: Mapping[str, Floats] | None = None,
    mountings: Mapping[str, Mounting] | None = None,
) -> Prediction:
    """Compare poses with an arm, its effects and its probe.

    States of artefacts are given by their ids, vectors of tools, (3,), and mountings of
    the instrument's probes by their names; what is missing is found here.

    Raises:
        IdentificationError: Arm and campaign do not fit together.

    Examples:
        An arm without errors, and a tracker that saw the ball to 10 micrometres: of
        three components a distance has 16 on average.

        >>> from importlib.resources import files
        >>> from traverse.kinematics.arm_file.arm import read_arm
        >>> from traverse.kinematics.model.forward import probe_centre
        >>> from traverse.kinematics.model.geometry import geometry_from_arm
        >>> from traverse.lab.campaign.campaign import campaign_of_places
        >>> arm = read_arm(files("traverse.cli") / "demo_data" / "arm.toml")
        >>> rng = np.random.default_rng(1)
        >>> readings_rad = rng.uniform(-2.0, 2.0, (200, 7))
        >>> places_mm = probe_centre(geometry_from_arm(arm), readings_rad)
        >>> places_mm += rng.normal(0.0, 0.01, places_mm.shape)
        >>> names = [joint.name for joint in arm.joints]
        >>> campaign = campaign_of_places(names, readings_rad, places_mm)
        >>> prediction = predict(campaign, arm, places={})
        >>> round(prediction.figures()["mean_mm"], 3)
        0.016
    """
    campaign = replace(campaign, prior=None)
    touched = campaign.poses.artefacts
    is_missing = np.array([entry.id not in places for entry in campaign.artefacts])
    if tools_mm is not None:
        campaign = campaign.with_tools(tools_mm)
    if np.any(is_missing[touched]):
        placing = placed(campaign.part(is_missing[touched]), arm)
        own_places = places_of(placing)
        if tools_mm is None:
            campaign = campaign.with_tools(placing.tools_mm)
    else:
        own_places = {}
    problem = Problem.of(campaign, arm, _PLACING)
    network, values, mounted = (
        problem.network(),
        problem.design,
        problem.parameters.mounted,
    )
    found_mm = np.full((len(touched), 3), np.nan)
    errors_rad = np.full((len(touched), 3), np.nan)
    states = [
        station.artefact.transferred(
            {**places, **own_places}[station.artefact.id], touches
        )
        for station in network.stations
        for touches in [station.touches]
    ]
    if mounted:
        turns = network.fitted_mountings(values, states)
        names = ["probe", *(tool.name for tool in campaign.tools)]
        for index, tool in enumerate(mounted):
            known = (mountings or {}).get(names[tool])
            turns[index] = turns[index] if known is None else known.quaternion
        values = replace(values, mountings=turns)
    for station, state in zip(network.stations, states, strict=True):
        artefact = station.artefact
        errors_rad[station.poses] = network.orientation_errors_rad(
            station, values, state
        )
        of_station_mm = network.misclosures_mm(station, values, state)
        found_mm[station.poses, : artefact.rows_per_pose] = of_station_mm
    return Prediction(campaign, found_mm, frozenset(own_places), errors_rad)


def predicted(
    judged: Campaign, arm: Arm, fit_on: Campaign | None = None, *, with_tool: bool
) -> tuple[Arm, Prediction]:
    """Predict poses with artefacts, tools and mountings found by others, or by them.

    Returns the arm, with the probe's vector that was found, and the prediction.

    Raises:
        IdentificationError: Arm and campaigns do not fit together.
    """
    placing = placed(judged if fit_on is None else fit_on, arm, with_tool=with_tool)
    places = {} if fit_on is None else places_of(placing)
    known = {} if fit_on is None else mountings_of(placing)
    return placing.arm, predict(judged, placing.arm, places, placing.tools_mm, known)


def curve_figures(
    judged: Campaign, arm: Arm, fit_on: Campaign | None = None, *, with_tool: bool
) -> dict[str, Any] | None:
    """Compare with the arm without its empirical curves; None where it has none.

    Gives how many poses lie beyond the knots of any, and the figures without them.

    Raises:
        IdentificationError: Arm and campaigns do not fit together.
    """
    without_curves = tuple(
        entry
        for entry in arm.effects
        if EFFECT_KINDS[entry.kind].family is not Family.CURVE
    )
    if len(without_curves) == len(arm.effects):
        return None
    model = Problem.of(judged, arm, _PLACING).parameters.required_effects
    beyond = pose_flags(model.effects, judged.block()).beyond_knots
    bare = arm.model_copy(update={"effects": without_curves})
    return {
        "n_beyond_knots": int(np.count_nonzero(beyond)),
        "without": predicted(judged, bare, fit_on, with_tool=with_tool)[1].figures(),
    }


def write_prediction(result: Prediction, path: Path) -> None:
    """Write a line for each pose: distance, and the misclosures that make it up.

    With orientations also by how much they are off about each axis.
    """
    header = ["distance_mm", "w1_mm", "w2_mm", "w3_mm"]
    columns = [result.distances_mm, result.misclosures_mm]
    if np.any(result.campaign.poses.oriented):
        header += [f"orientation_{axis}_rad" for axis in "xyz"]
        columns.append(result.orientation_errors_rad)
    values = np.column_stack(columns)
    result.campaign.write_table(path, header, lambda row: texts(values[row]))


def holdout_figures(
    result: Identification, kept_aside: Campaign, by: str, seed: int
) -> dict[str, Any]:
    """Compare poses that took no part with the input arm and the identified one.

    The probe's vector of the input arm is fitted to the poses that took part. The poses
    kept aside, of the same artefacts, were chosen by groups and a seed.
    """
    # The tool is part of the last link, which is free in the result.
    _, before = predicted(kept_aside, result.design, result.campaign, with_tool=True)
    known = places_of(result), result.tools_mm, mountings_of(result)
    after = predict(kept_aside, result.arm, *known)
    return {
        "by": by,
        "seed": seed,
        "distance_mm": {"before": before.figures(), "after": after.figures()},
        "artefacts": after.by_artefact(),
    }
