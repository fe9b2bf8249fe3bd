"""A part of known truth, touched by arms that are known within a covariance.

The part: a plate with an edge and two holes, a shaft, and a cone. Of each part sizes
and places are drawn; of each arm its parameters, then noise of readings and contacts.
The true arm is the independent one of the tests of uncertainty.
"""

from dataclasses import dataclass

import numpy as np

from tests.kinematics.uncertainty.test_joint_covariance import CONTACT_MM, ENCODER_RAD
from tests.kinematics.uncertainty.test_point_covariance import centres_mm
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.features.measured import Definition, Touches
from traverse.kinematics.uncertainty.joint_covariance import JointCovariance
from traverse.kinematics.uncertainty.point_covariance import point_uncertainties

TIP_MM, TIP_STD_MM = 3.0, 0.004


@dataclass(frozen=True)
class Part:
    """Balls' centres that touch a part, (n, 3), with directions to the material."""

    definitions: list[Definition]
    centres_mm: np.ndarray
    towards: np.ndarray
    truth: dict[str, float]


def ring(n, radius_mm, heights_mm, phase=0.0):
    turns = 2 * np.pi * np.arange(n) / n + phase
    out = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(n)])
    return radius_mm * out + np.outer(heights_mm, [0, 0, 1]), out


def drawn_part(rng, at_mm, turn) -> Part:
    d = {
        "hole a": 20.0 + rng.uniform(-0.2, 0.2),
        "hole b": 12.0 + rng.uniform(-0.2, 0.2),
        "shaft": 25.0 + rng.uniform(-0.2, 0.2),
    }
    half_angle = np.deg2rad(20.0 + rng.uniform(-0.5, 0.5))
    a = np.array([-25.0, 0.0, 0.0])
    b = np.array([25.0 + rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), 0.0])
    pieces: list[tuple[str, np.ndarray, np.ndarray]] = []
    flat = np.array([[x, y, 0.0] for x in (-40, 0, 40) for y in (-18, 18)])
    down = np.tile([0.0, 0, -1], (6, 1))
    pieces.append(("plate", flat - TIP_MM * down, down))
    edge = np.array([[x, -20.0, -2.0] for x in (-38, -13, 13, 38)])
    inwards = np.tile([0.0, 1, 0], (4, 1))
    pieces.append(("edge", edge - TIP_MM * inwards, inwards))
    for name, place, n in (("hole a", a, 8), ("hole b", b, 6)):
        depths_mm = -2.0 - 3.0 * (np.arange(n) % 2)
        touched, out = ring(n, d[name] / 2 - TIP_MM, depths_mm)
        pieces.append((name, touched + place, out))
    pieces.append(shaft(d["shaft"]))
    pieces.append(cone(half_angle))
    definitions, centres, towards, start = [], [], [], 0
    kinds = {"plate": "plane", "edge": "line", "shaft": "cylinder", "cone": "cone"}
    for name, touched, to in pieces:
        rows = tuple(range(start, start + len(touched)))
        in_plate = "plate" if name == "edge" or "hole" in name else None
        kind = kinds.get(name, "circle")
        definitions.append(Definition(name, kind, rows, plane=in_plate))
        start += len(touched)
        centres.append(touched)
        towards.append(to)
    place = {"a": turn @ a + at_mm, "b": turn @ b + at_mm}
    truth = {
        "hole a diameter": d["hole a"],
        "hole b diameter": d["hole b"],
        "shaft diameter": d["shaft"],
        "cone angle": 2 * half_angle,
        **{f"hole {k} {'xyz'[i]}": place[k][i] for k in "ab" for i in range(3)},
        "hole a to hole b": float(np.linalg.norm(b - a)),
        "hole a to edge": 20.0,
        "shaft to edge": 20.0,
        "apex to plate": CONE_APEX_MM,
        "shaft to plate angle": np.pi / 2,
        "edge to plate angle": 0.0,
        "shaft to cone": 0.0,
        **{f"{name} form": 0.0 for name, _, _ in pieces},
    }
    return Part(
        definitions,
        np.concatenate(centres) @ turn.T + at_mm,
        np.concatenate(towards) @ turn.T,
        truth,
    )


CONE_APEX_MM = 70.0


def shaft(diameter_mm):
    """Three rings of five touches about the z axis."""
    rings = [
        ring(5, diameter_mm / 2 + TIP_MM, np.full(5, height_mm), 0.4 * number)
        for number, height_mm in enumerate((5.0, 17.0, 30.0))
    ]
    touched = np.concatenate([points_mm for points_mm, _ in rings])
    return "shaft", touched, -np.concatenate([out for _, out in rings])


def cone(half_angle):
    """Three rings of five touches on a cone about the z axis, its apex above."""
    touched, to = [], []
    for number, below_mm in enumerate((12.0, 20.0, 30.0)):
        _, out = ring(5, 1.0, np.zeros(5), 0.4 * number)
        surface = out * below_mm * np.tan(half_angle)
        surface += np.array([0.0, 0.0, CONE_APEX_MM - below_mm])
        normal = out * np.cos(half_angle) + np.array([0, 0, np.sin(half_angle)])
        touched.append(surface + TIP_MM * normal)
        to.append(-normal)
    return "cone", np.concatenate(touched), np.concatenate(to)


def reaching(place, angles_rad, wanted_mm):
    """Find postures whose balls are at places, by Newton steps.

    Args:
        place: where balls are, of postures (n, n_joints).
        angles_rad: start, (n, n_joints).
        wanted_mm: (n, 3).
    """
    n_joints = angles_rad.shape[1]
    for _ in range(30):
        off_mm = wanted_mm - place(angles_rad)
        if np.abs(off_mm).max() < 1e-9:
            return angles_rad
        steps = 1e-6 * np.eye(n_joints)
        columns = [place(angles_rad + s) - place(angles_rad - s) for s in steps]
        jacobian = np.stack(columns, axis=2) / 2e-6
        turns = np.einsum("nji,ni->nj", np.linalg.pinv(jacobian), off_mm)
        angles_rad = angles_rad + np.clip(turns, -0.2, 0.2)
    raise AssertionError(f"{np.abs(off_mm).max()} mm short")


def touched(bench, part, nominal_rad, rng, contact_mm=None) -> Touches:
    """Touch a part with one arm of the kind that the bench's covariance states."""
    factor = bench.arm.factor
    values = bench.values + factor @ rng.normal(size=factor.shape[1])

    def true_place(angles_rad):
        each = np.tile(values, (len(angles_rad), 1))
        return centres_mm(bench.geometry, bench.effects, angles_rad, each)

    if contact_mm is None:
        contact_mm = CONTACT_MM * rng.normal(size=part.centres_mm.shape)
    at_rad = reaching(true_place, nominal_rad, part.centres_mm + contact_mm)
    read_rad = at_rad + ENCODER_RAD * rng.normal(size=at_rad.shape)
    uncertainties = point_uncertainties(
        bench.geometry, bench.effects, Block(read_rad), bench.noise, bench.arm
    )
    errors = JointCovariance(
        bench.measured(read_rad, None),
        uncertainties.covariances_mm2,
        uncertainties.shared_mm,
    )
    n = len(read_rad)
    stated_mm = TIP_MM + TIP_STD_MM * rng.normal()
    is_measured = np.ones(n, dtype=bool)
    return Touches(errors, stated_mm, TIP_STD_MM, part.towards, is_measured)
