"""The same physics in another form: rigid motions (4x4) of the undeflected arm.

Whatever a joint does beyond turning moves all that it carries, as a rigid motion about
where the joint is undeflected; the outermost joint moves first.
"""

from datetime import UTC, datetime

import numpy as np

from traverse.kinematics.arm_file.arm import effect_from_table, parse_arm

N_JOINTS = 6
NAMES = [f"J{k}" for k in range(1, N_JOINTS + 1)]
EPOCH = datetime(2026, 11, 20, 9, tzinfo=UTC)
EPOCH_NS = 1_795_165_200_000_000_000
T_REF = 21.5


def random_arm(seed):
    rng = np.random.default_rng(seed)

    def vector(size):
        return np.round(rng.uniform(-size, size, 3), 6).tolist()

    lines = ['schema = "traverse/arm/1"', 'name = "odd"', f"origin_mm = {vector(300)}"]
    for k, name in enumerate(NAMES):
        lines += ["[[joints]]", f'name = "{name}"', f"axis = {vector(1)}"]
        lines += [f"link_mm = {vector(400)}", f"zero_rad = {rng.uniform(-3, 3)}"]
        if k != 2:
            lines += [f"mass_kg = {rng.uniform(0.2, 3)}"]
        if k % 2:
            lines += [f"centre_of_mass_mm = {vector(200)}"]
    direction = vector(1)
    lines += ["[probe]", "radius_mm = 3.0", 'kind = "switching"']
    lines += [f"vector_mm = {vector(80)}", f"direction = {direction}"]
    lines += ["mass_kg = 0.3", "[reference]", f"temperature_c = {T_REF}"]
    lines += ["gravity_m_s2 = [0.3, -0.8, -9.7]"]
    return parse_arm("\n".join(lines))


def effect(kind, **keys):
    return effect_from_table({"kind": kind, **keys})


def rotation(vector):
    """Rodrigues' formula for a rotation vector, 3x3."""
    angle = np.linalg.norm(vector)
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew


def about(point, vector):
    motion = np.eye(4)
    motion[:3, :3] = rotation(np.asarray(vector))
    motion[:3, 3] = point - motion[:3, :3] @ point
    return motion


def shifted(vector):
    motion = np.eye(4)
    motion[:3, 3] = vector
    return motion


class Rigid:
    def __init__(self, geometry, turns):
        self.carried = [np.eye(4)]  # the motion of what carries joint k, k from 0
        place = geometry.origin_mm
        self.origins, self.axes, self.links, self.ends = [], [], [], []
        for axis, link, turned in zip(
            geometry.axes, geometry.links_mm, turns, strict=True
        ):
            carrier = self.carried[-1]
            self.origins.append((carrier @ [*place, 1])[:3])
            self.axes.append(carrier[:3, :3] @ axis)
            self.carried.append(carrier @ about(place, turned * axis))
            self.links.append(self.carried[-1][:3, :3] @ link)
            place = place + link
        last = self.carried[-1]
        self.ball = (last @ [*(place + geometry.probe_vector_mm), 1])[:3]
        self.shank = last[:3, :3] @ geometry.probe_direction

    def moment_nm(self, arm, joint, gravity):
        """Weight by weight, about a joint's origin."""
        total = np.zeros(3)
        for k in range(joint, len(self.origins)):
            body = arm.joints[k]
            centre = body.centre_of_mass_mm
            if centre is None:
                arm_mm = self.links[k] / 2
            else:
                arm_mm = self.carried[k + 1][:3, :3] @ centre
            lever_m = (self.origins[k] + arm_mm - self.origins[joint]) / 1000
            total += np.cross(lever_m, (body.mass_kg or 0.0) * gravity)
        lever_m = (self.ball - self.origins[joint]) / 1000
        return total + np.cross(lever_m, arm.probe.mass_kg * gravity)

    def moved(self, motions):
        """Let joints (and -1, the base) move all that they carry, base last."""
        motion = np.eye(4)
        for joint in sorted(motions):
            motion = motion @ motions[joint]
        return (motion @ [*self.ball, 1])[:3], motion[:3, :3] @ self.shank


def random_readings(seed, n_samples=4):
    return np.random.default_rng(seed).uniform(-4, 4, (n_samples, N_JOINTS))
