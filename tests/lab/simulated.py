"""Simulated campaigns for the tests: an arm of 3 x 3 matrices, no code under test.

Rodrigues' formula as matrices, inverse kinematics by Newton's method, noise added to
readings and contacts.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from traverse.kinematics.arm_file.arm import Arm, parse_arm
from traverse.kinematics.model.geometry import Geometry
from traverse.lab.artefacts import artefact_from_table
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.campaign.poses import Poses

PROBE_RADIUS_MM = 3.0


def rotations(axis, angles):
    """R(axis, angle) as matrices, (n, 3, 3)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sines, cosines = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.eye(3) + sines * cross + (1 - cosines) * (cross @ cross)


@dataclass(frozen=True)
class TrueArm:
    """u_k, r_k and zeros; x_0 is included."""

    axes: np.ndarray
    links_mm: np.ndarray
    zeros_rad: np.ndarray
    origin_mm: np.ndarray

    def centres(self, angles_rad):
        return self._chain(angles_rad)[0]

    def centres_and_slopes(self, angles_rad):
        """Centres (n, 3), and how they follow the angles, (n, 3, n_joints).

        A joint turns the centre about its axis: u x (centre - where the axis is).
        """
        centres, starts, directions = self._chain(angles_rad)
        slopes = np.cross(directions, centres[:, None] - starts)
        return centres, slopes.swapaxes(1, 2)

    def _chain(self, angles_rad):
        """Centres; the place of every axis and its direction, (n, n_joints, 3)."""
        turned = np.broadcast_to(np.eye(3), (len(angles_rad), 3, 3))
        centres = np.tile(self.origin_mm, (len(angles_rad), 1))
        starts, directions = [], []
        for k in range(len(self.axes)):
            angle = angles_rad[:, k] - self.zeros_rad[k]
            starts.append(centres)
            directions.append(turned @ self.axes[k])
            turned = turned @ rotations(self.axes[k], angle)
            centres = centres + turned @ self.links_mm[k]
        return centres, np.stack(starts, axis=1), np.stack(directions, axis=1)

    def geometry(self) -> Geometry:
        return Geometry(
            self.origin_mm,
            self.axes,
            self.links_mm,
            self.zeros_rad,
            np.zeros(3),
            self.links_mm[-1] / np.linalg.norm(self.links_mm[-1]),
        )


def seven_joints() -> TrueArm:
    """Roll, hinge, roll, hinge, roll, hinge, roll; 1.2 m, the probe off its axis."""
    z, y, x = np.eye(3)[[2, 1, 0]]
    return TrueArm(
        axes=np.array([z, y, x, y, x, y, x]),
        links_mm=np.array(
            [
                [0, 0, 220.0],
                [60, 0, 0],
                [500, 0, 0],
                [50, 0, 0],
                [440, 0, 0],
                [40, 0, 0],
                [145, 0, -60.0],
            ]
        ),
        zeros_rad=np.array([0.35, 2.1, -0.8, 1.57, 0.05, -1.2, 0.6]),
        origin_mm=np.array([10.0, -20.0, 30.0]),
    )


DESIGN = seven_joints()


def disturbed(arm: TrueArm, seed: int, link_mm=1.0, axis_rad=0.005) -> TrueArm:
    """The same arm as built, with errors."""
    rng = np.random.default_rng(seed)
    axes = arm.axes + rng.normal(size=arm.axes.shape) * axis_rad
    return TrueArm(
        axes / np.linalg.norm(axes, axis=1, keepdims=True),
        arm.links_mm + rng.normal(size=arm.links_mm.shape) * link_mm,
        arm.zeros_rad,
        arm.origin_mm,
    )


def built(seed: int, link_mm=1.0, axis_rad=0.005) -> TrueArm:
    """The seven joints of the design as built, with errors."""
    return disturbed(DESIGN, seed, link_mm, axis_rad)


def in_another_posture(arm: TrueArm, turns_rad) -> TrueArm:
    """Write the same arm in the posture that these turns lead to."""
    turned = np.eye(3)
    axes, links = [], []
    for k, turn in enumerate(turns_rad):
        axes.append(turned @ arm.axes[k])
        turned = turned @ rotations(arm.axes[k], np.array([turn]))[0]
        links.append(turned @ arm.links_mm[k])
    return TrueArm(
        np.array(axes), np.array(links), arm.zeros_rad + turns_rad, arm.origin_mm
    )


def postures(arm: TrueArm, targets_mm, rng, travel_rad):
    """Find random postures that bring the ball to each target, (n, n_joints)."""
    n_joints = len(arm.axes)
    angles_rad = np.empty((len(targets_mm), n_joints))
    missing = np.arange(len(targets_mm))
    for _ in range(400):
        if len(missing) == 0:
            return angles_rad
        turns = rng.uniform(-1, 1, (len(missing), n_joints)) * travel_rad
        angles = arm.zeros_rad + turns
        moving = np.arange(len(missing))  # rows leave when they have arrived
        for _ in range(25):
            centres, slopes = arm.centres_and_slopes(angles[moving])
            away = targets_mm[missing[moving]] - centres
            far = np.linalg.norm(away, axis=1) > 1e-10
            moving, away, slopes = moving[far], away[far], slopes[far]
            if len(moving) == 0:
                break
            square = slopes @ slopes.swapaxes(1, 2) + 10.0 * np.eye(3)
            step = slopes.swapaxes(1, 2) @ np.linalg.solve(square, away[:, :, None])
            angles[moving] = np.clip(
                angles[moving] + np.clip(step[:, :, 0], -0.3, 0.3),
                arm.zeros_rad - travel_rad,
                arm.zeros_rad + travel_rad,
            )
        away = np.linalg.norm(targets_mm[missing] - arm.centres(angles), axis=1)
        good = away < 1e-6
        angles_rad[missing[good]] = angles[good]
        missing = missing[~good]
    raise RuntimeError(f"{len(missing)} targets were not reached")


@dataclass(frozen=True)
class Noise:
    encoder_rad: float = 5e-6
    contact_mm: float = 0.005


def random_directions(rng, n):
    vectors = rng.normal(size=(n, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def targets_of(table, rng, n, place_mm):
    """Choose ball centres for one artefact: targets, features, and its table."""
    kind = table["kind"]
    features = np.array([""] * n, dtype=object)
    if kind == "cone":
        return np.tile(place_mm, (n, 1)), features
    if kind == "sphere":
        radius = table.get("radius_mm", 25.4)
        sign = 1 if table.get("side", "outside") == "outside" else -1
        reach = radius + sign * PROBE_RADIUS_MM
        return place_mm + reach * random_directions(rng, n), features
    if kind == "ball_bar":
        along = random_directions(rng, 1)[0] * table["distance_mm"] / 2
        which = np.arange(n) % 2
        features[:] = np.array(["1", "2"], dtype=object)[which]
        middle = np.where(which[:, None] == 0, place_mm - along, place_mm + along)
        reach = np.broadcast_to(table["radius_mm"], (2,))[which] + PROBE_RADIUS_MM
        return middle + reach[:, None] * random_directions(rng, n), features
    by_kind = {
        "seats": seats_targets,
        "draw_wire": wire_targets,
        "points": points_targets,
    }
    return by_kind.get(kind, plane_targets)(table, rng, n, place_mm)


def seats_targets(table, rng, n, place_mm):
    """The first seat, and the others around it at their distances from it."""
    first, names, places = "1", ["1", "2"], [np.zeros(3)]
    distances = [table["distance_mm"]] if "distance_mm" in table else []
    if not distances:
        first = table["distances"][0]["between"][0]
        assert all(row["between"][0] == first for row in table["distances"])
        names = [first, *(row["between"][1] for row in table["distances"])]
        distances = [row["distance_mm"] for row in table["distances"]]
    ways = random_directions(rng, len(distances))
    places += list(ways * np.array(distances)[:, None])
    which = np.arange(n) % len(names)
    return place_mm + np.array(places)[which], np.array(names, dtype=object)[which]


WIRE_OFFSET_MM = 35.0


def wire_targets(table, rng, n, place_mm):
    """Places in one octant around the anchor."""
    drawn_mm = rng.uniform(80, 300, n)[:, None]
    octant = np.abs(random_directions(rng, n)) * [-1, -1, 1]
    return place_mm + drawn_mm * octant, np.array([""] * n, dtype=object)


def read_lengths(table, targets_mm, place_mm):
    """What a draw wire reads; NaN for everything else, (n,)."""
    if table["kind"] != "draw_wire":
        return np.full(len(targets_mm), np.nan)
    return np.linalg.norm(targets_mm - place_mm, axis=1) - WIRE_OFFSET_MM


def plane_targets(table, rng, n, place_mm):
    features = np.array([""] * n, dtype=object)
    normal = random_directions(rng, 1)[0]
    first = np.cross(normal, random_directions(rng, 1)[0])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    plate = rng.uniform(-150, 150, (n, 2)) @ np.stack([first, second])
    if table["kind"] == "plane":
        return place_mm + plate + PROBE_RADIUS_MM * normal, features
    which = np.arange(n) % 2
    features[:] = np.array(["1", "2"], dtype=object)[which]
    sign = 1 if table.get("side", "outside") == "outside" else -1
    half = table["distance_mm"] / 2 + sign * PROBE_RADIUS_MM
    return place_mm + plate + (2 * which - 1)[:, None] * half * normal, features


def points_targets(table, rng, n, place_mm):
    features = np.array([""] * n, dtype=object)
    names = list(table["points_mm"])
    which = np.arange(n) % len(names)
    features[:] = np.array(names, dtype=object)[which]
    known = np.array([table["points_mm"][name] for name in names])[which]
    if table["frame"] == "arm":
        return known, features
    turned = rotations(random_directions(rng, 1)[0], rng.uniform(1, 2, 1))[0]
    return place_mm + known @ turned.T * table.get("true_scale", 1.0), features


def simulate(
    arm: TrueArm,
    tables,
    n_each,
    seed,
    *,
    noise=None,
    travel_rad=np.pi,
    radius_mm=650.0,
) -> Campaign:
    """Measure artefacts placed at random around the arm.

    `tables` are those of a campaign file; `place_mm` in one puts it somewhere.
    """
    noise = noise or Noise()
    rng = np.random.default_rng(seed)
    travel_rad = np.broadcast_to(travel_rad, (len(arm.axes),))
    artefacts, all_angles, indices, features, names = [], [], [], [], []
    lengths = []
    for index, entry in enumerate(tables):
        table = dict(entry)
        height = rng.uniform(-150, 400)
        around = rng.uniform(-np.pi, np.pi)
        x_mm, y_mm = radius_mm * np.cos(around), radius_mm * np.sin(around)
        place = arm.origin_mm + np.array([x_mm, y_mm, height])
        place = np.array(table.pop("place_mm", place))
        targets, touched = targets_of(table, rng, n_each, place)
        lengths.append(read_lengths(table, targets, place))
        table.pop("true_scale", None)
        artefact = artefact_from_table(table)
        artefacts.append(artefact)
        angles = postures(
            arm,
            targets + rng.normal(size=targets.shape) * noise.contact_mm,
            rng,
            travel_rad,
        )
        all_angles.append(angles + rng.normal(size=angles.shape) * noise.encoder_rad)
        listed = artefact.features or ("",)
        names.append(listed)
        features.append([listed.index(name) for name in touched])
        indices.append(np.full(n_each, index))
    n_poses = n_each * len(tables)
    return Campaign(
        artefacts=tuple(artefacts),
        feature_names=tuple(names),
        joint_names=tuple(f"J{k + 1}" for k in range(len(arm.axes))),
        poses=Poses(
            lines=np.arange(2, n_poses + 2),
            time_s=np.arange(n_poses, dtype=float),
            artefacts=np.concatenate(indices),
            features=np.concatenate(features).astype(np.int64),
            angles_rad=np.concatenate(all_angles),
            lengths_mm=None
            if np.isnan(np.concatenate(lengths)).all()
            else np.concatenate(lengths),
        ),
        encoder_rad=noise.encoder_rad or None,
        contact_mm=noise.contact_mm or None,
    )


def seen_places(angles_rad, centres_mm, **noise) -> Campaign:
    """Places of the ball that a tracker saw, in its own system, as a campaign."""
    n_poses = len(centres_mm)
    names = tuple(f"P{index}" for index in range(n_poses))
    table = {
        "id": "tracker",
        "kind": "points",
        "frame": "own",
        "points_mm": dict(zip(names, centres_mm.tolist(), strict=True)),
    }
    return Campaign(
        artefacts=(artefact_from_table(table),),
        feature_names=(names,),
        joint_names=tuple(f"J{k + 1}" for k in range(angles_rad.shape[1])),
        poses=Poses(
            lines=np.arange(2, n_poses + 2),
            time_s=np.arange(n_poses, dtype=float),
            artefacts=np.zeros(n_poses, dtype=np.int64),
            features=np.arange(n_poses),
            angles_rad=angles_rad,
        ),
        **noise,
    )


def arm_value(arm: TrueArm, name="bench") -> Arm:
    """The arm as an arm file's value."""
    joints = "".join(
        f"""
[[joints]]
name = "J{k + 1}"
axis = {arm.axes[k].tolist()}
link_mm = {arm.links_mm[k].tolist()}
zero_rad = {float(arm.zeros_rad[k])}
"""
        for k in range(len(arm.axes))
    )
    return parse_arm(
        f"""schema = "traverse/arm/1"
name = "{name}"
origin_mm = {arm.origin_mm.tolist()}
{joints}
[probe]
radius_mm = {PROBE_RADIUS_MM}
kind = "hard"
[reference]
temperature_c = 20.0
gravity_m_s2 = [0.0, 0.0, -9.80665]
"""
    )


DESIGN_ARM = arm_value(DESIGN)


def cones(n, **more):
    return [{"id": f"cone-{i}", "kind": "cone", **more} for i in range(n)]


def bar(**more):
    return {
        "id": "bar",
        "kind": "ball_bar",
        "radius_mm": 12.7,
        "distance_mm": 400.0,
        **more,
    }


def toml_value(value):
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k} = {toml_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    return json.dumps(value)


def written(campaign: Campaign, folder: Path) -> Path:
    """Write a campaign as the files of a folder."""
    lines = ['schema = "traverse/campaign/1"', 'poses = "poses.csv"', "[noise]"]
    lines += [f"encoder_rad = {campaign.encoder_rad}"] if campaign.encoder_rad else []
    lines += [f"contact_mm = {campaign.contact_mm}"] if campaign.contact_mm else []
    for artefact in campaign.artefacts:
        lines.append("[[artefacts]]")
        table = artefact.model_dump(exclude_unset=True)
        points = table.pop("points_mm", None)
        lines += [f"{key} = {toml_value(value)}" for key, value in table.items()]
        if points:
            lines.append("[artefacts.points_mm]")
            lines += [f"{name} = {list(at)}" for name, at in points.items()]
    (folder / "campaign.toml").write_text("\n".join(lines) + "\n")
    poses = campaign.poses
    rows = [
        ["time_s", "artefact", "feature", *(f"{n}_rad" for n in campaign.joint_names)]
    ]
    if poses.lengths_mm is not None:
        rows[0].append("length_mm")
    for at in range(len(poses)):
        index = poses.artefacts[at]
        feature = campaign.feature_names[index][poses.features[at]]
        angles = [repr(float(angle)) for angle in poses.angles_rad[at]]
        rows.append(
            [str(poses.time_s[at]), campaign.artefacts[index].id, feature, *angles]
        )
        if poses.lengths_mm is not None:
            length = float(poses.lengths_mm[at])
            rows[-1].append("" if np.isnan(length) else repr(length))
    (folder / "poses.csv").write_text("\n".join(",".join(row) for row in rows) + "\n")
    return folder
