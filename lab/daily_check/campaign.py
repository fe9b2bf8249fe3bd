"""Campaign and plan of a daily check, for the guided collection."""

from pathlib import Path

from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.acceptance.plan import Plan, Step
from traverse.lab.acceptance.plan_files import CAMPAIGN, campaign_text, plan_text
from traverse.lab.collection.plan import PLAN
from traverse.lab.measured_points.measurement import reach_of

CONE, BALL = "cone", "sphere"
CONE_TOUCHES, SPHERE_TOUCHES = 10, 9


def write_check(folder: Path, arm: Arm, radius_mm: float) -> None:
    """Write campaign.toml and plan.toml of a check into a new folder."""
    shoulder_mm, reach_mm = reach_of(arm)
    half = CONE_TOUCHES // 2
    steps = [
        Step(
            CONE,
            side,
            n,
            f"the cone, {n} points with the elbow to the {side}, another posture each "
            "time, the same ones every day",
        )
        for side, n in (("left", half), ("right", CONE_TOUCHES - half))
    ]
    steps.append(
        Step(
            BALL,
            "",
            SPHERE_TOUCHES,
            f"the sphere, {SPHERE_TOUCHES} points: 1 on the pole, 4 at 45 degrees from "
            "it, 4 on the equator",
        )
    )
    plan = Plan(
        {CONE: {"kind": "cone"}, BALL: {"kind": "sphere", "radius_mm": radius_mm}},
        tuple(steps),
        tuple(shoulder_mm.tolist()),
        reach_mm,
    )
    folder.mkdir(parents=True)
    (folder / CAMPAIGN).write_text(campaign_text(plan), "utf-8")
    (folder / PLAN).write_text(plan_text(plan), "utf-8")
