"""Arms compared at the probe: placing does not count, geometry does."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.lab.simulated import (
    TrueArm,
    arm_value,
    disturbed,
    rotations,
    seven_joints,
)
from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.identification.results.arm_comparison import (
    ComparisonError,
    compare_arms,
)

TRUE = seven_joints()


def placed_elsewhere(arm: TrueArm) -> TrueArm:
    """The same arm, turned and shifted as a whole."""
    turn = rotations(np.array([2.0, -1.0, 2.0]) / 3.0, np.array([0.7]))[0]
    return replace(
        arm,
        axes=arm.axes @ turn.T,
        links_mm=arm.links_mm @ turn.T,
        origin_mm=arm.origin_mm + np.array([400.0, -30.0, 20.0]),
    )


def in_another_posture(arm: TrueArm, turns_rad: np.ndarray) -> TrueArm:
    """The same arm, its vectors written in another posture."""
    turned, axes, links = np.eye(3), [], []
    for axis, link, turn in zip(arm.axes, arm.links_mm, turns_rad, strict=True):
        axes.append(turned @ axis)
        turned = turned @ rotations(axis, np.array([turn]))[0]
        links.append(turned @ link)
    return TrueArm(
        np.array(axes), np.array(links), arm.zeros_rad + turns_rad, arm.origin_mm
    )


def test_an_arm_is_like_itself() -> None:
    found = compare_arms(arm_value(TRUE), arm_value(TRUE))
    assert found.rms_mm == pytest.approx(0.0, abs=1e-9)
    assert found.turn_rad == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("at", ["elsewhere", "in another posture"])
def test_placing_and_posture_do_not_count(at: str) -> None:
    turns_rad = np.linspace(-0.9, 1.1, 7)
    other = (
        placed_elsewhere(TRUE)
        if at == "elsewhere"
        else in_another_posture(TRUE, turns_rad)
    )
    found = compare_arms(arm_value(TRUE), arm_value(other))
    assert found.largest_mm == pytest.approx(0.0, abs=1e-8)
    if at == "elsewhere":
        assert found.turn_rad == pytest.approx(0.7, abs=1e-9)
        assert found.shift_rms_mm > 100.0


def test_differences_are_those_of_an_independent_fit() -> None:
    first, second = disturbed(TRUE, 1), placed_elsewhere(disturbed(TRUE, 2))
    least, most = TRUE.zeros_rad - 1.0, TRUE.zeros_rad + 1.5
    found = compare_arms(arm_value(first), arm_value(second), (least, most), 500)
    assert np.all((found.largest_at_rad >= least) & (found.largest_at_rad <= most))
    # The same postures drawn again, to fit them with an independent function.
    rng = np.random.default_rng(20_171_101)
    angles_rad = rng.uniform(least, most, (500, 7))
    first_mm, second_mm = first.centres(angles_rad), second.centres(angles_rad)
    onto_mm = first_mm - first_mm.mean(axis=0)
    local_mm = second_mm - second_mm.mean(axis=0)
    turn, _ = Rotation.align_vectors(onto_mm, local_mm)
    apart_mm = np.linalg.norm(turn.apply(local_mm) - onto_mm, axis=1)
    assert found.rms_mm == pytest.approx(np.sqrt(np.mean(apart_mm**2)), rel=1e-9)
    assert found.median_mm == pytest.approx(np.median(apart_mm), rel=1e-9)
    assert found.largest_mm == pytest.approx(apart_mm.max(), rel=1e-9)
    worst = int(np.argmax(apart_mm))
    np.testing.assert_allclose(found.largest_at_mm, first_mm[worst], atol=1e-9)
    np.testing.assert_array_equal(found.largest_at_rad, angles_rad[worst])


def test_zones_share_out_all_postures() -> None:
    found = compare_arms(arm_value(TRUE), arm_value(disturbed(TRUE, 1)))
    assert [zone.name for zone in found.zones] == ["near", "middle", "far"]
    assert sum(zone.n_postures for zone in found.zones) == found.n_postures
    filled = [zone for zone in found.zones if zone.n_postures]
    squares = sum(zone.n_postures * zone.rms_mm**2 for zone in filled)
    assert squares == pytest.approx(found.n_postures * found.rms_mm**2, rel=1e-9)
    assert max(zone.largest_mm for zone in filled) == found.largest_mm


def test_arms_of_other_joints_are_refused_by_name() -> None:
    arm = arm_value(TRUE)
    fewer: Arm = arm.model_copy(update={"joints": arm.joints[:-1], "name": "short"})
    with pytest.raises(ComparisonError, match=r"'short' J1, J2, J3, J4, J5, J6;"):
        compare_arms(arm, fewer)
