"""Faults without a name, against values by hand, and a fault of one's own."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from tests.simulator.effects.examples import example, heavy_arm, spec_of
from traverse.simulator.campaigns import Cone, PoseSet, make_poses, with_effects
from traverse.simulator.effects import (
    BodyFault,
    Bump,
    CrossCoupling,
    CubicError,
    Fault,
    JumpInAngle,
    Sawtooth,
    SquareOfTemperature,
)
from traverse.simulator.effects.posture import Deflection, Posture

RIGID = make_poses(heavy_arm(), spec_of(Cone(id="cone", n_poses=5)), seed=9)
SECOND = slice(1, 2)


def errors_rad(fault: Fault, angles_rad: list[float]) -> list[float]:
    """Errors of the second encoder at angles; the first joint is at 0.5."""
    poses = with_effects(RIGID, [], [fault])
    turns_rad = poses.turns_rad.copy()
    zeros_rad = poses.truth.zeros_rad
    turns_rad[:, 0] = 0.5 - zeros_rad[0]
    turns_rad[:, 1] = np.array(angles_rad) - zeros_rad[1]
    shown_rad = poses.faulty.readings_rad(turns_rad, poses.around)
    wrong_rad = shown_rad - (turns_rad + zeros_rad)
    assert not np.any(np.delete(wrong_rad, 1, axis=1))
    return wrong_rad[:, 1].tolist()


@pytest.mark.parametrize(
    ("fault", "expected_rad"),
    [
        (Bump(SECOND, 1.0, 0.5, 4e-5), [0.0, 2e-5, 4e-5, 2e-5, 0.0]),
        (JumpInAngle(SECOND, 0.99, 3e-5), [0.0, 0.0, 3e-5, 3e-5, 3e-5]),
        (
            Sawtooth(SECOND, 2, 1e-4),
            [1e-4 * ((a / np.pi) % 1.0 - 0.5) for a in (-1.0, 0.75, 1.0, 1.25, 4.0)],
        ),
        (CrossCoupling(SECOND, 0, 2e-5, 3, 0.1), [2e-5 * np.sin(1.6)] * 5),
    ],
)
def test_a_fault_is_as_described(fault, expected_rad):
    found_rad = errors_rad(fault, [-1.0, 0.75, 1.0, 1.25, 4.0])
    np.testing.assert_allclose(found_rad, expected_rad, rtol=0, atol=2e-15)


def test_a_cubic_grows_from_the_base_posture():
    zero_rad = RIGID.truth.zeros_rad[1]
    turns_rad = np.array([-1.0, -0.5, 0.0, 0.5, 2.0])
    found_rad = errors_rad(CubicError(SECOND, 1e-5), (zero_rad + turns_rad).tolist())
    expected_rad = [-1e-5, -1.25e-6, 0.0, 1.25e-6, 8e-5]
    np.testing.assert_allclose(found_rad, expected_rad, rtol=0, atol=2e-15)


def test_a_square_of_temperature_is_equal_for_warm_and_cold():
    warm_c = np.array([18.0, 19.0, 20.0, 21.0, 22.0])
    around = replace(RIGID.around, temperature_c=warm_c)
    poses = with_effects(
        replace(RIGID, around=around), [], [SquareOfTemperature(SECOND, 1e-5)]
    )
    wrong_rad = poses.readings_rad - RIGID.readings_rad
    expected_rad = [4e-5, 1e-5, 0.0, 1e-5, 4e-5]
    np.testing.assert_allclose(wrong_rad[:, 1], expected_rad, rtol=0, atol=2e-15)


@dataclass(frozen=True, slots=True)
class BendingElement(BodyFault):
    """Written outside the simulator: an element that bends when it is warm."""

    def move(self, posture: Posture, yielding: Deflection) -> None:
        warmer_c = posture.around.temperature_c - 20.0
        yielding.tilts_rad[3] += 1e-4 * warmer_c[:, None] * np.array([0.0, 0.0, 1.0])


def ball_mm(poses: PoseSet) -> np.ndarray:
    return poses.faulty.balls_mm(poses.turns_rad, poses.around)


def test_a_fault_of_ones_own_is_played_beside_named_effects():
    bending = BendingElement()
    poses = with_effects(RIGID, [example("joint_compliance")], [bending])
    assert poses.faults == (bending,)
    np.testing.assert_allclose(ball_mm(poses), RIGID.contacts_mm, rtol=0, atol=1e-9)
    without = with_effects(RIGID, [example("joint_compliance")])
    assert np.max(np.abs(poses.turns_rad - without.turns_rad)) > 1e-5
