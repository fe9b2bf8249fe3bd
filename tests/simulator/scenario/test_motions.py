from itertools import pairwise

import numpy as np
import pytest

from traverse.simulator.arm.physics import probe_pose
from traverse.strict_toml.problems import FileError

SPHERE = """
[[motion]]
kind = "sphere"
centre_mm = [500.0, 100.0, 50.0]
radius_mm = 50.8
points = 12
"""
BAR = """
[[motion]]
kind = "ball_bar"
centre_mm = [450.0, 0.0, 50.0]
direction = [0.0, 1.0, 0.0]
distance_mm = 800.0
radius_mm = 25.4
points = 5
"""
PLANE = """
[[motion]]
kind = "plane"
centre_mm = [500.0, 0.0, 0.0]
normal = [0.1, 0.0, 1.0]
"""
CONE = """
[[motion]]
kind = "cone"
seat_mm = [480.0, 50.0, 20.0]
postures = 6
"""


def centres_at(arm, script, times_s):
    centres, _ = probe_pose(arm.truth.mechanism, script.turns(np.array(times_s)))
    return centres


def presses(script, name="button"):
    return [e for e in script.events if e.level == 1 and e.input_name == name]


def test_every_touch_of_a_sphere_is_exactly_on_it(stage):
    arm, script = stage(SPHERE)
    touched = presses(script)
    assert len(touched) == 12
    centres = centres_at(arm, script, [e.time_s for e in touched])
    distances = np.linalg.norm(centres - [500.0, 100.0, 50.0], axis=1)
    np.testing.assert_allclose(distances, 53.8, atol=1e-9, rtol=0)
    for event, centre in zip(touched, centres, strict=True):
        ball = np.array(event.surface_mm) + 3.0 * np.array(event.normal)
        np.testing.assert_allclose(ball, centre, atol=1e-9, rtol=0)


def test_the_ball_rests_from_press_to_release(stage):
    arm, script = stage(SPHERE)
    pressed, released = script.events[0], script.events[1]
    assert released.level == 0
    assert released.time_s - pressed.time_s == pytest.approx(0.05)
    centres = centres_at(arm, script, np.linspace(pressed.time_s, released.time_s, 9))
    assert np.max(np.abs(centres - centres[0])) == 0.0


def test_both_spheres_of_a_bar_are_touched(stage):
    arm, script = stage(BAR)
    for feature, y_mm in (("1", -400.0), ("2", 400.0)):
        touched = [e for e in presses(script) if e.feature == feature]
        centres = centres_at(arm, script, [e.time_s for e in touched])
        distances = np.linalg.norm(centres - [450.0, y_mm, 50.0], axis=1)
        np.testing.assert_allclose(distances, [28.4] * 5, atol=1e-9, rtol=0)


def test_contacts_on_a_plane_are_one_radius_above_it(stage):
    arm, script = stage(PLANE)
    centres = centres_at(arm, script, [e.time_s for e in presses(script)])
    normal = np.array([0.1, 0.0, 1.0]) / np.sqrt(1.01)
    assert len(centres) == 16
    np.testing.assert_allclose((centres - [500.0, 0, 0]) @ normal, 3.0, atol=1e-9)


def test_a_cone_is_always_the_same_point_in_other_postures(stage):
    arm, script = stage(CONE)
    times_s = [e.time_s for e in presses(script)]
    centres = centres_at(arm, script, times_s)
    np.testing.assert_allclose(centres - [480.0, 50.0, 20.0], 0.0, atol=1e-9)
    turns = script.turns(np.array(times_s))
    assert np.min(np.linalg.norm(np.diff(turns, axis=0), axis=1)) > 0.2


def test_the_ball_stays_in_its_seat_or_is_taken_out_altogether(stage):
    arm, script = stage(CONE.replace("postures = 6", "postures = 20"))
    pressed = [e.time_s for e in presses(script)]
    seated = 0
    for start_s, end_s in pairwise(pressed):
        centres = centres_at(arm, script, np.linspace(start_s, end_s, 500))
        play = np.max(np.linalg.norm(centres - [480.0, 50.0, 20.0], axis=1))
        assert play < 0.1 or play > 14.9
        seated += play < 0.1
    assert seated > 10


def test_a_switching_probe_closes_at_contact_while_it_moves(stage):
    arm, script = stage(SPHERE, kind="switching")
    assert not presses(script)
    closed = presses(script, "switch")
    assert len(closed) == 12
    times_s = np.array([e.time_s for e in closed])
    middle = np.array([500.0, 100.0, 50.0])
    at_contact_mm, later = (
        np.linalg.norm(centres_at(arm, script, times_s + t) - middle, axis=1)
        for t in (0.0, 1e-3)
    )
    np.testing.assert_allclose(at_contact_mm, 53.8, atol=1e-9, rtol=0)
    np.testing.assert_allclose((at_contact_mm - later) / 1e-3, 10.0, atol=0.05)


def test_a_switching_probe_opens_at_contact_on_the_way_back(stage):
    arm, script = stage(SPHERE, kind="switching")
    opened = [e.time_s for e in script.events if e.level == 0]
    distances = np.linalg.norm(
        centres_at(arm, script, opened) - [500.0, 100.0, 50.0], axis=1
    )
    np.testing.assert_allclose(distances, 53.8, atol=1e-9, rtol=0)


@pytest.mark.parametrize("over", ["sphere", "plane"])
def test_a_sweep_stays_in_contact_while_the_button_is_held(stage, over):
    arm, script = stage(
        f'[[motion]]\nkind = "sweep"\nover = "{over}"\n'
        "centre_mm = [500.0, 0.0, 0.0]\nradius_mm = 50.0\nwindings = 2.0\n"
        "speed_mm_s = 200.0\n"
    )
    pressed, released = script.events
    times_s = np.linspace(pressed.time_s, released.time_s, 3001)
    centres = centres_at(arm, script, times_s)
    if over == "sphere":
        off = np.linalg.norm(centres - [500.0, 0.0, 0.0], axis=1) - 53.0
    else:
        off = centres[:, 2] - 3.0
    assert np.max(np.abs(off)) < 1e-4


def test_motion_is_continuous_and_returns_when_it_repeats(stage):
    _, script = stage(SPHERE + CONE, "repeat = true")
    times_s = np.linspace(0.0, script.duration_s, 200_000)
    speeds = np.diff(script.turns(times_s), axis=0) / times_s[1]
    assert np.max(np.abs(speeds)) < 15.0
    # As by a hand between targets; 15 mm of approach in 0.1 s are quicker.
    quickest_rad_s2 = np.max(np.abs(np.diff(speeds, axis=0))) / times_s[1]
    assert quickest_rad_s2 < 200.0
    assert np.array_equal(script.turns(np.array([script.duration_s])), np.zeros((1, 7)))
    number = len(script.events)
    assert script.event(number)[0] == script.duration_s + script.events[0].time_s


def test_unreachable_targets_are_said_with_the_motion(stage):
    far = SPHERE.replace("500.0, 100.0", "2500.0, 100.0")
    with pytest.raises(FileError) as caught:
        stage(CONE + far)
    assert "motion[1] (sphere)" in str(caught.value)
    assert "12 of 12 contacts" in str(caught.value)


def test_equal_seeds_give_equal_scripts(stage):
    first, second = stage(SPHERE)[1], stage(SPHERE)[1]
    assert first.events == second.events
    assert np.array_equal(first.trajectory.coefficients, second.trajectory.coefficients)
