"""Points of a part that the demonstration's identified arm has touched."""

from functools import cache
from pathlib import Path

import numpy as np

import traverse.cli
from tests.client.display.values import point
from tests.kinematics.features.parts import TIP_MM, drawn_part, reaching
from traverse.kinematics.arm_file.arm import arm_digest, read_arm
from traverse.kinematics.effects.arm_effects import effects_from_arm
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.model.forward import probe_pose
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.kinematics.uncertainty.arm_covariance import read_parameter_covariance
from traverse.kinematics.uncertainty.point_covariance import (
    PointNoise,
    point_uncertainties,
)
from traverse.protocol.messages import Point

ARM = Path(traverse.cli.__file__).parent / "demo_data" / "identified.toml"
PLAN = """\
schema = "traverse/features/1"
part = "plate 12"
serial = "0007"
operator = "A. Weber"
ball_radius_std_mm = 0.0005

[part_temperature]
temperature_c = 20.0
temperature_std_c = 0.2
expansion_per_c = 11.5e-6
expansion_std_per_c = 1e-6

[[features]]
name = "plate"
kind = "plane"

[[features]]
name = "edge"
kind = "line"
plane = "plate"

[[features]]
name = "hole a"
kind = "circle"
plane = "plate"

[[features]]
name = "hole b"
kind = "circle"
side = "inside"
plane = "plate"

[[features]]
name = "shaft"
kind = "cylinder"

[[features]]
name = "cone"
kind = "cone"

[[relations]]
name = "pitch"
kind = "distance"
of = ["hole a", "hole b"]

[[relations]]
name = "tip"
kind = "apex"
of = ["cone"]

[[relations]]
name = "height"
kind = "distance"
of = ["tip", "plate"]

[[relations]]
name = "squareness"
kind = "angle"
of = ["shaft", "plate"]

[[tolerances]]
of = "hole a"
figure = "diameter"
nominal_mm = 20.0
lower_mm = -0.5
upper_mm = 0.5

[[tolerances]]
of = "pitch"
figure = "distance"
nominal_mm = 50.0
lower_mm = -1.0
upper_mm = 1.0

[[tolerances]]
of = "squareness"
figure = "angle"
nominal_deg = 90.0
lower_deg = -0.5
upper_deg = 0.5
"""


@cache
def touched_points() -> tuple[tuple[Point, ...], dict[str, float]]:
    """Return points labelled with their features, and the part's truth."""
    arm = read_arm(ARM)
    geometry, effects = geometry_from_arm(arm), effects_from_arm(arm)

    def place(angles_rad):
        return probe_pose(geometry, angles_rad)[0]

    rng = np.random.default_rng(12)
    folded_rad = np.array([0.2, -0.6, 0.3, 1.1, 0.4, 0.8, 0.1])
    start_rad = (geometry.zeros_rad + folded_rad)[np.newaxis]
    part = drawn_part(rng, place(start_rad)[0], np.eye(3))
    n = len(part.centres_mm)
    noise_mm = 0.005 * rng.normal(size=(n, 3))
    angles_rad = reaching(place, np.tile(start_rad, (n, 1)), part.centres_mm + noise_mm)
    covariance = read_parameter_covariance(ARM, arm, effects, effects)
    noise = PointNoise(np.full(7, 5e-6), np.zeros(7), 0.005, 0.0)
    stated = point_uncertainties(
        geometry, effects, Block(angles_rad), noise, covariance
    )
    centres_mm, shanks = probe_pose(geometry, angles_rad)
    names = {row: d.name for d in part.definitions for row in d.rows}
    surfaces_mm = centres_mm + TIP_MM * part.towards
    upper = np.triu_indices(3)
    return tuple(
        point(
            row,
            arm=arm.name,
            model=arm_digest(arm),
            angles_rad=angles_rad[row].tolist(),
            xyz_mm=centres_mm[row].tolist(),
            ijk=shanks[row].tolist(),
            surface_mm=surfaces_mm[row].tolist(),
            compensation="pulled",
            covariance_mm2=stated.covariances_mm2[row][upper].tolist(),
            probe_radius_mm=TIP_MM,
            label={"artefact": "plate 12", "feature": names[row]},
            quality={"ok": True, "flags": []},
            part_xyz_mm=None,
            temperature_c=None,
        )
        for row in range(n)
    ), part.truth
