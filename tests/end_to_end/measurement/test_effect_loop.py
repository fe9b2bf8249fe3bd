"""The loop closed: the daemon takes out effects that the simulator plays.

The simulator has its own physics, the board's bytes go through a pty, the driver and
the daemon's measuring path; the truth log says where the ball was. Every effect is
measured with the arm file that holds it and with one that does not.
"""

import numpy as np
import pytest

from tests.end_to_end.measurement.effect_loop import (
    COUNTS_PER_TURN,
    N_POINTS,
    Measured,
    measured,
)
from tests.simulator.campaigns.arms import ball_centres_mm
from tests.simulator.effects.examples import example
from traverse.kinematics.effect_table import EFFECT_KINDS, Family
from traverse.kinematics.effects.base.block import Block
from traverse.kinematics.effects.pose import contact_shifts
from traverse.protocol.messages import Quality

# A script lasts seconds, a campaign minutes; the steps are between two points.
CHANGES = {
    "encoder_drift": {"rate_rad_s": 1e-5},
    "base_drift": {"rate_mm_s": [0.01, -0.01, 0.02]},
    "count_slip": {"at_s": 2.5},
    "base_step": {"at_s": 2.5},
}
MANY = 100.0  # times: how much worse it is without the effect, at least
# The daemon takes a speed from two readings, 1 ms apart or up to a period more.
LOOK_BACK_S = np.linspace(1e-3, 11e-3, 21)
LATENCY_S = 2e-3


def kinds_of(*classes):
    return [
        k
        for k, kind in EFFECT_KINDS.items()
        if kind.effect_class in classes and kind.family is not Family.MASS
    ]


def entry(kind):
    return example(kind, **CHANGES.get(kind, {}))


def levers_mm(run: Measured) -> np.ndarray:
    """How far the ball moves for a turn of each joint by 1 rad, (n, n_joints)."""
    angles_rad = np.array([point.angles_rad for point in run.points])
    step = 1e-6
    columns = []
    for joint in range(angles_rad.shape[1]):
        off = np.zeros(angles_rad.shape[1])
        off[joint] = step
        ahead = ball_centres_mm(run.arm, angles_rad + off)
        back = ball_centres_mm(run.arm, angles_rad - off)
        columns.append(np.linalg.norm(ahead - back, axis=1) / (2.0 * step))
    return np.stack(columns, axis=1)


def rounding_mm(run: Measured) -> np.ndarray:
    """Half a count of every joint, all of them in the worst sense, (n,)."""
    return levers_mm(run) @ np.full(7, np.pi / COUNTS_PER_TURN)


def lag_mm(run: Measured) -> np.ndarray:
    """Error of a mean speed over the last few ms times `LATENCY_S`, (n,)."""
    script, now_s = run.board.script, run.script_s
    turns_rad, speeds_rad_s = script.turns(now_s), script.speeds(now_s)
    off_rad_s = [
        np.abs((turns_rad - script.turns(now_s - back_s)) / back_s - speeds_rad_s)
        for back_s in LOOK_BACK_S
    ]
    worst_rad = LATENCY_S * np.max(off_rad_s, axis=0)
    return np.sum(levers_mm(run) * worst_rad, axis=1)


def lengths(vectors):
    return np.linalg.norm(vectors, axis=1)


# The last kind of each family alone; all are in the test of all at once.
OF_A_FAMILY = {EFFECT_KINDS[kind].family: kind for kind in kinds_of("L", "A")}


@pytest.mark.slow
@pytest.mark.parametrize("kind", OF_A_FAMILY.values())
def test_points_agree_with_the_truth_by_the_adapted_file_alone(
    tmp_path, monkeypatch, kind
):
    run = measured(tmp_path, monkeypatch, entry(kind))
    # Both sides follow one table of laws, second orders included. What is left is
    # from the loop: counts are whole, and a speed is a mean over some ms of the past.
    most_mm = rounding_mm(run)
    if kind == "encoder_latency":
        most_mm = most_mm + lag_mm(run)
    assert (lengths(run.misses_mm) < most_mm).all()
    assert lengths(run.bare_misses_mm).max() > MANY * most_mm.max()
    flags = ("empirical",) if kind == "empirical" else ()
    assert {p.quality for p in run.points} == {Quality(ok=True, flags=flags)}
    assert {p.quality for p in run.bare} == {Quality(ok=True, flags=())}


@pytest.mark.parametrize("kind", ["backlash", "joint_compliance"])
def test_coupled_joints_agree_with_the_truth(tmp_path, monkeypatch, kind):
    couplings = {"J2": ("J1", 0.5), "J3": ("J2", -1.0), "J5": ("J4", 0.4)}
    run = measured(tmp_path, monkeypatch, entry(kind), couplings=couplings)
    most_mm = rounding_mm(run)
    assert (lengths(run.misses_mm) < most_mm).all()
    assert lengths(run.bare_misses_mm).max() > MANY * most_mm.max()


@pytest.mark.parametrize("kind", kinds_of("D"))
def test_what_needs_the_surface_is_flagged_and_closes_once_it_is_known(
    tmp_path, monkeypatch, kind
):
    run = measured(tmp_path, monkeypatch, entry(kind))
    unknown = Quality(ok=False, flags=("surface_unknown",))
    assert {point.quality for point in run.points} == {unknown}
    # Left out, not half applied.
    assert np.allclose(run.misses_mm, run.bare_misses_mm, rtol=0, atol=1e-9)
    block = Block(
        angles_rad=np.array([point.angles_rad for point in run.points]),
        directions=-np.array([line["normal"] for line in run.truth]),
    )
    shifts_mm = contact_shifts(run.model.geometry, run.model.effects, block)
    most_mm = rounding_mm(run)
    assert (lengths(run.misses_mm + shifts_mm) < most_mm).all()
    assert lengths(run.misses_mm).max() > MANY * most_mm.max()


def test_all_effects_at_once_are_taken_out_of_noisy_readings(tmp_path, monkeypatch):
    noise_rad = 5e-7
    effects = [entry(kind) for kind in kinds_of("L", "A")]
    run = measured(tmp_path, monkeypatch, *effects, noise_rad=noise_rad)
    # The noise of a reading, and that of two in a speed over 1 ms at the worst; the
    # speed is that of readings with their effects, of the second order.
    each_rad = noise_rad * np.hypot(1.0, np.sqrt(2.0) * LATENCY_S / 1e-3)
    noise_mm = 4.0 * each_rad * lengths(levers_mm(run))
    most_mm = noise_mm + rounding_mm(run) + 2.0 * lag_mm(run)
    assert (lengths(run.misses_mm) < most_mm).all()
    assert lengths(run.bare_misses_mm).max() > MANY * most_mm.max()
    assert {p.quality.flags for p in run.points} == {("empirical",)}


def test_every_kind_that_the_daemon_applies_is_here():
    tested_kinds = {*kinds_of("L", "A"), *kinds_of("D")}
    assert {*EFFECT_KINDS} - tested_kinds == {"artefact_length", "first_moment"}
    assert N_POINTS >= 4  # two before a step, two after it
