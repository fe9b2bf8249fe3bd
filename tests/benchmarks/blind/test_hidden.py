"""Hidden effects of the blind test: drawn from a seed, of every kind, in arm files."""

import ast

import numpy as np
import pytest

from benchmarks.blind.hidden.effects import EFFECT_KINDS, drawn_effect
from benchmarks.blind.hidden.faults import CURVE, FAULT_KINDS, drawn_fault
from benchmarks.blind.hidden.poses import pose_set, weighed
from tests.docs.pages import CHECKOUT
from tests.simulator.campaigns.arms import seven_joint_arm
from traverse.kinematics.arm_file.arm import parse_arm
from traverse.kinematics.effect_table import EFFECT_KINDS as CONTRACT_KINDS
from traverse.strict_toml.rewriting import rewritten_text


@pytest.fixture(scope="module")
def poses():
    return pose_set(seven_joint_arm(), 1, 2)


def rng(seed=0):
    return np.random.default_rng(seed)


def test_every_kind_of_the_contract_is_hidden():
    # A first moment moves nothing itself.
    assert {*EFFECT_KINDS, CURVE, "first_moment"} == set(CONTRACT_KINDS)


def test_at_least_five_kinds_have_no_name():
    assert len(set(FAULT_KINDS) - set(CONTRACT_KINDS)) >= 5


def test_equal_seeds_draw_equal_effects(poses):
    for kind in EFFECT_KINDS:
        first, second = (drawn_effect(rng(3), poses, kind) for _ in range(2))
        assert first == second
        assert first.kind == kind


def test_an_arm_file_takes_what_is_drawn(poses):
    for seed in range(4):
        effects = tuple(drawn_effect(rng(seed), poses, k).entry for k in EFFECT_KINDS)
        arm = poses.arm.model_copy(update={"effects": effects})
        values = arm.model_dump(by_alias=True, exclude_none=True)
        assert parse_arm(rewritten_text(values, None)).effects == effects


def test_only_sizes_grow(poses):
    for kind in EFFECT_KINDS:
        effect = drawn_effect(rng(1), poses, kind)
        larger = effect.scaled(3.0)
        assert larger.fixed == effect.fixed
        for key, size in effect.sizes.items():
            assert larger.sizes[key] == pytest.approx(3.0 * np.array(size))


def test_all_joints_and_orders_come(poses):
    drawn = [drawn_effect(rng(seed), poses, "encoder_harmonic") for seed in range(300)]
    assert {effect.joint for effect in drawn} == {j.name for j in poses.arm.joints}
    orders = [effect.fixed["order"] for effect in drawn]
    assert {2, 3, 4} < set(orders)
    assert max(orders) > 10


def test_latency_is_of_one_joint_or_of_all(poses):
    drawn = [drawn_effect(rng(seed), poses, "encoder_latency") for seed in range(40)]
    assert {effect.joint is None for effect in drawn} == {True, False}


def test_steps_come_while_it_is_measured(poses):
    times_s = poses.around.time_s
    for seed in range(20):
        at_s = drawn_effect(rng(seed), poses, "count_slip").fixed["at_s"]
        assert times_s[10] < at_s < times_s[-10]


@pytest.mark.parametrize("kind", ["axis_wobble", "axis_runout"])
def test_vectors_lie_across_or_along_the_axis(poses, kind):
    for seed in range(10):
        effect = drawn_effect(rng(seed), poses, kind)
        axis = next(j.axis for j in poses.arm.joints if j.name == effect.joint)
        axis = np.array(axis) / np.linalg.norm(axis)
        for vector in effect.sizes.values():
            along = np.dot(vector, axis)
            if effect.fixed.get("component") == "axial":
                assert vector == pytest.approx(along * axis)
            else:
                assert along == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("kind", FAULT_KINDS)
def test_faults_grow_in_proportion(poses, kind):
    fault = drawn_fault(rng(2), poses, kind)
    (key,) = set(fault.keys) - {"covariate", "knots"}
    assert fault.scaled(2.5).keys[key] == pytest.approx(2.5 * np.array(fault.keys[key]))


def test_a_coupling_is_with_another_joint(poses):
    for seed in range(20):
        fault = drawn_fault(rng(seed), poses, "cross-coupling")
        assert fault.covariate != f"{fault.joint}_rad"


def test_masses_of_the_file_are_kept():
    arm = seven_joint_arm()
    heavy = arm.joints[0].model_copy(update={"mass_kg": 9.0})
    arm = arm.model_copy(update={"joints": (heavy, *arm.joints[1:])})
    arm_with_masses = weighed(arm)
    assert arm_with_masses.joints[0].mass_kg == 9.0
    assert all(joint.mass_kg is not None for joint in arm_with_masses.joints)


def test_poses_tell_everything_that_effects_depend_on(poses):
    assert 450 <= poses.n_poses <= 520
    assert np.ptp(poses.around.temperature_c) > 1.0
    assert set(np.unique(poses.around.approach)) == {-1, 1}
    assert np.std(poses.around.speed_rad_s) == pytest.approx(0.3, rel=0.1)
    assert poses.spec.conditions.start_utc is not None


def test_what_hides_shares_no_code_with_what_is_tested():
    """It imports the simulator and, of the rest, only the reader of arm files."""
    known = (
        "benchmarks.blind.hidden",
        "traverse.simulator",
        "traverse.kinematics.arm_file",
    )
    folder = CHECKOUT / "benchmarks" / "blind" / "hidden"
    imported = {
        node.module
        for path in folder.glob("*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module
    }
    ours = {
        name for name in imported if name.split(".")[0] in {"traverse", "benchmarks"}
    }
    assert len(ours) > 5
    assert [name for name in ours if not name.startswith(known)] == []
