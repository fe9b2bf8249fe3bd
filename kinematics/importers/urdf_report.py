"""An arm as a robot description (URDF), and how much of the arm that leaves out."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from re import sub
from typing import Any, NamedTuple
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

import numpy as np
from numpy.typing import ArrayLike

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.kinematics.effects.arm_effects import effects_from_arm
from traverse.kinematics.effects.base.block import Block, Covariate
from traverse.kinematics.effects.base.correction import Correction
from traverse.kinematics.effects.pose import corrected_pose
from traverse.kinematics.importers.dh_report import random_readings_rad, sizes_mm
from traverse.kinematics.importers.urdf import Mimic, roll_pitch_yaw, turned_by
from traverse.kinematics.model.forward import probe_pose
from traverse.kinematics.model.geometry import Geometry, across, geometry_from_arm

# What an arm that rests in a room at its reference temperature says of a sample.
_AT_REST = {Covariate.TEMPERATURE, Covariate.SPEED, Covariate.APPROACH}


def urdf_report(arm: Arm, postures: int, seed: int) -> tuple[dict[str, Any], str]:
    """Write an arm as a robot description and measure its errors at the probe.

    A joint's value in the description is the joint's reading. Frames are those of the
    arm, turned with the joints; the link `probe` is at the ball's centre with z along
    the shank. A joint that is read and coupled becomes two, one of which mimics.

    Args:
        arm: Any.
        postures: How many random ones, each joint within half a turn of its zero.
        seed: Of the postures, and of the sides from which they are approached.

    Returns:
        The report as plain values, and the description with the report as comment.

    Raises:
        ValueError: Effects of the arm file cannot be applied to this arm.
    """
    geometry = geometry_from_arm(arm)
    effects = effects_from_arm(arm)
    at_rest_effects, unseen = list[Correction](), list[Correction]()
    for correction in effects.corrections:
        needs = {need.covariate for need in correction.needs}
        at_rest = needs <= _AT_REST and correction not in effects.contacts
        (at_rest_effects if at_rest else unseen).append(correction)
    readings_rad = random_readings_rad(geometry, postures, seed)
    readings_rad[:, _led(arm)] = geometry.zeros_rad[_led(arm)]
    sides = np.random.default_rng(seed).choice([-1.0, 1.0], readings_rad.shape)
    block = Block(
        readings_rad,
        speeds_rad_s=np.zeros_like(readings_rad),
        approaches=sides,
        temperature_c=np.full(postures, arm.reference.temperature_c),
    )
    seen_effects = replace(effects, corrections=tuple(at_rest_effects))
    gaps_mm = corrected_pose(geometry, seen_effects, block)[0]
    gaps_mm -= probe_pose(geometry, readings_rad)[0]
    report = {
        "schema": "traverse/urdf-report/1",
        "arm": arm.name,
        "joints": [joint.name for joint in arm.joints],
        "loss_mm": {
            **sizes_mm(np.linalg.norm(gaps_mm, axis=1), seed),
            "temperature_c": arm.reference.temperature_c,
        },
        "not_in_loss": [effects.name(correction) for correction in unseen],
        "not_in_urdf": list(_not_in_urdf(arm, map(effects.name, effects.corrections))),
    }
    return report, _description(arm, geometry, urdf_remarks(report))


def urdf_remarks(report: Mapping[str, Any]) -> Iterator[str]:
    """Describe effects that a robot description leaves out in lines of text."""
    loss = report["loss_mm"]
    yield (
        f"lost at the probe over {loss['postures']} random postures (seed "
        f"{loss['seed']}, at rest, {loss['temperature_c']:g} C): rms "
        f"{loss['rms']:.3g} mm, largest {loss['max']:.3g} mm"
    )
    if report["not_in_loss"]:
        names = ", ".join(report["not_in_loss"])
        yield f"not in these figures, for want of a time or a surface: {names}"
    for omission in report["not_in_urdf"]:
        yield f"not in the description: {omission}"


def _not_in_urdf(arm: Arm, effects: Iterable[str]) -> Iterator[str]:
    if names := ", ".join(effects):
        yield f"effects ({names})"
    if any(joint.encoder for joint in arm.joints):
        yield "encoders (a joint's value is its reading in rad)"
    if any(joint.mass_kg for joint in arm.joints) or arm.probe.mass_kg:
        yield "extent of masses (they are points, with inertias of 0)"
    if arm.identification is not None:
        yield "identification and covariance: nothing tells how certain the axes are"
    yield "the temperature and the gravity at which the geometry holds"


def _led(arm: Arm) -> list[int]:
    return [k for k, j in enumerate(arm.joints) if j.coupled_to and j.encoder is None]


class _Hinge(NamedTuple):
    """A joint of the description; its turn is its value less `zero_rad`."""

    name: str
    axis: Floats | None
    zero_rad: float = 0.0
    mimic: Mimic | None = None


def _hinges(arm: Arm, geometry: Geometry, k: int) -> Iterator[_Hinge]:
    """Yield the hinges that describe joint k: those that follow another, its own."""
    joint, axis, led = arm.joints[k], geometry.axes[k], _led(arm)
    # The reading of a joint that is led never changes, so it leads nothing.
    ways = [c for c in geometry.couplings if c.joint == k and c.other not in led]
    for _, master, ratio in ways:
        name = f"{joint.name}_by_{arm.joints[master].name}"
        while any(name == urdf_joint.name for urdf_joint in arm.joints):
            name += "_"
        offset_rad = -ratio * float(geometry.zeros_rad[master])
        mimic = Mimic(arm.joints[master].name, ratio, offset_rad)
        yield _Hinge(joint.name if k in led else name, axis, mimic=mimic)
    if k not in led:
        yield _Hinge(joint.name, axis, joint.zero_rad)
    elif not ways:
        yield _Hinge(joint.name, None)


def _description(arm: Arm, geometry: Geometry, remarks: Iterable[str]) -> str:
    robot = Element("robot", name=arm.name)
    # Two hyphens end a comment, and names of joints may have them.
    robot.extend(Comment(f" {sub('-(?=-)', '- ', line)} ") for line in remarks)
    SubElement(robot, "link", name="base")
    parent, place = "base", np.eye(4)
    place[:3, 3] = geometry.origin_mm
    for k, joint in enumerate(arm.joints):
        for hinge in _hinges(arm, geometry, k):
            if hinge.axis is not None:
                place = place @ turned_by(hinge.axis, -hinge.zero_rad)
            link = _add(robot, hinge, parent, f"{hinge.name}_link", place)
            parent, place = f"{hinge.name}_link", np.eye(4)
        if joint.mass_kg is not None:
            middle_mm = 0.5 * geometry.links_mm[k]
            _add_mass(link, joint.mass_kg, joint.centre_of_mass_mm or middle_mm)
        place[:3, 3] = geometry.links_mm[k]
    shank = geometry.probe_direction
    first, second = across(shank)
    place[:3, :3] = np.column_stack([first, second, shank])
    place[:3, 3] += geometry.probe_vector_mm
    link = _add(robot, _Hinge("probe.mount", None), parent, "probe", place)
    if arm.probe.mass_kg is not None:
        _add_mass(link, arm.probe.mass_kg, np.zeros(3))
    if arm.probe.radius_mm > 0.0:
        ball = SubElement(SubElement(link, "visual"), "geometry")
        SubElement(ball, "sphere", radius=_numbers([1e-3 * arm.probe.radius_mm]))
    indent(robot)
    return f"{tostring(robot, 'unicode', xml_declaration=True)}\n"


def _add(
    robot: Element, hinge: _Hinge, parent: str, child: str, place: Floats
) -> Element:
    """Add a joint and the link behind it, which is returned; `place` in mm, (4, 4)."""
    kind = "fixed" if hinge.axis is None else "continuous"
    joint = SubElement(robot, "joint", name=hinge.name, type=kind)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    xyz, rpy = _numbers(1e-3 * place[:3, 3]), _numbers(roll_pitch_yaw(place[:3, :3]))
    SubElement(joint, "origin", xyz=xyz, rpy=rpy)
    if hinge.axis is not None:
        SubElement(joint, "axis", xyz=_numbers(hinge.axis))
    if hinge.mimic is not None:
        ratio, offset = (_numbers([value]) for value in hinge.mimic[1:])
        SubElement(
            joint, "mimic", joint=hinge.mimic.joint, multiplier=ratio, offset=offset
        )
    return SubElement(robot, "link", name=child)


def _add_mass(link: Element, mass_kg: float, centre_mm: ArrayLike) -> None:
    inertial = SubElement(link, "inertial")
    SubElement(inertial, "origin", xyz=_numbers(1e-3 * np.asarray(centre_mm)))
    SubElement(inertial, "mass", value=_numbers([mass_kg]))
    # A point has none; readers of descriptions want all six.
    moments = dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "0")
    SubElement(inertial, "inertia", moments)


def _numbers(values: Iterable[float]) -> str:
    # Adding zero turns -0.0 into 0.0.
    return " ".join(repr(float(value) + 0.0) for value in values)
