"""Whether a specification fits together and fits its arm."""

from collections.abc import Iterator

import numpy as np

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm
from traverse.simulator.arm.physics import Mechanism, probe_pose
from traverse.simulator.campaigns.artefacts import Artefact
from traverse.simulator.campaigns.mixes import mix_artefacts
from traverse.simulator.campaigns.postures import drawn_turns
from traverse.simulator.campaigns.spec import CampaignSpec, spec_problems
from traverse.simulator.campaigns.streams import stream
from traverse.strict_toml.problems import Problem

N_LOOKS = 1000  # postures that determine the width of the working volume


def spec_artefacts(
    spec: CampaignSpec, mechanism: Mechanism, limits_rad: Floats, seed: int
) -> tuple[Artefact, ...]:
    """The artefacts of a specification that fits, in sizes for the arm."""
    if spec.mix is None or spec.n_poses is None:
        return spec.artefacts
    width_mm = _width_mm(mechanism, limits_rad, stream(seed, "sizes"))
    return mix_artefacts(spec.mix, spec.n_poses, width_mm)


def _width_mm(
    mechanism: Mechanism, limits_rad: Floats, rng: np.random.Generator
) -> float:
    """How wide the working volume is: three sigma where it is thinnest.

    Never more than the stretched arm: wide volumes are hollow.
    """
    places_mm, _ = probe_pose(mechanism, drawn_turns(limits_rad, N_LOOKS, rng))
    thinnest_mm2 = float(np.linalg.eigvalsh(np.cov(places_mm.T))[0])
    corners_mm = np.vstack([mechanism.origins_mm, mechanism.probe_mm])
    reach_mm = np.sum(np.linalg.norm(np.diff(corners_mm, axis=0), axis=1))
    return float(min(3.0 * np.sqrt(max(thinnest_mm2, 0.0)), reach_mm))


def misfits(spec: CampaignSpec, arm: Arm) -> Iterator[Problem]:
    """Find everything that does not fit."""
    yield from spec_problems(spec.model_dump(exclude_unset=True))
    joints = [joint.name for joint in arm.joints]
    for key, given in (
        ("limits_rad", spec.limits_rad),
        ("noise.encoders_rad", spec.noise.encoders_rad),
    ):
        if given is not None and len(given) != len(joints):
            message = (
                f"has {len(given)} entries; the arm has {len(joints)} joints, "
                f"{', '.join(joints)}; give one for each"
            )
            yield Problem(key, message)
    bare = [joint.name for joint in arm.joints if joint.encoder is None]
    if spec.noise.quantised and bare:
        message = (
            f"the arm file gives no encoder of {', '.join(bare)}; add its "
            "counts_per_turn there or leave readings unrounded"
        )
        yield Problem("noise.quantised", message)
    for number, artefact in enumerate(spec.artefacts):
        problem = artefact.size_problem(arm.probe.radius_mm)
        if problem is not None:
            yield Problem(f"artefacts[{number}]", problem)
