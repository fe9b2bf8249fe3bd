"""MuJoCo: nested bodies on hinges."""

from collections.abc import Iterator

import mujoco as mj
import numpy as np

from benchmarks.peers.peer import Peer, offsets_mm
from traverse.arrays import Floats
from traverse.kinematics.model.geometry import Geometry


def peer(geometry: Geometry) -> Peer:
    """`mj_kinematics` of hinges, and the site at the ball."""
    steps_mm = offsets_mm(geometry)
    bodies = "".join(_bodies(steps_mm, geometry.axes))
    model = mj.MjModel.from_xml_string(
        '<mujoco><compiler angle="radian"/><worldbody>'
        f"{bodies}{'</body>' * geometry.n_joints}</worldbody></mujoco>"
    )
    data = mj.MjData(model)
    kinematics, turns, site = mj.mj_kinematics, data.qpos, data.site_xpos[0]

    def single(turns_rad: Floats) -> Floats:
        turns[:] = turns_rad
        kinematics(model, data)
        return site

    def batch(turns_rad: Floats) -> Floats:
        centres_mm = np.empty((len(turns_rad), 3))
        for row, sample in enumerate(turns_rad):
            turns[:] = sample
            kinematics(model, data)
            centres_mm[row] = site
        return centres_mm

    return Peer("MuJoCo", mj.__version__, single, batch)


def _bodies(steps_mm: Floats, axes: Floats) -> Iterator[str]:
    for k, axis in enumerate(axes):
        place = " ".join(map(repr, steps_mm[k].tolist()))
        along = " ".join(map(repr, axis.tolist()))
        # A body must weigh something; kinematics do not look at it.
        yield (
            f'<body pos="{place}"><inertial pos="0 0 0" mass="1" '
            f'diaginertia="1 1 1"/><joint type="hinge" axis="{along}"/>'
        )
    end = " ".join(map(repr, steps_mm[-1].tolist()))
    yield f'<site name="ball" pos="{end}"/>'
