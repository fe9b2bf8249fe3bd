"""The covariance that points state, against thousands of points of a simulated arm.

The simulator's own physics moves the arm, and its encoders, with noise, are read at
instants that are a little off; the daemon's measuring path measures with an arm file
that is a little wrong, each time in another way. Where the ball truly was must lie in
the stated ellipsoid of 95 % for 95 of 100 points.
"""

import hashlib
from dataclasses import replace

import numpy as np
import pytest

from tests.daemon.values import SetClock
from tests.end_to_end.measurement.effect_loop import Daemon
from tests.end_to_end.workbench import DEMO_ARM, SWEEP
from traverse.daemon.config.schema import UncertaintySection
from traverse.drivers.base.values import CountSamples, DeviceUp, Identity, LatchedCounts
from traverse.kinematics.arm_file.arm import Identification, read_arm, write_arm
from traverse.kinematics.uncertainty.arm_covariance import parameter_names
from traverse.simulator.config import SimulatorConfig, config_problems
from traverse.simulator.virtual_arm import (
    build_arm,
    build_course,
    build_script,
    encoders_of,
)
from traverse.strict_toml.reader import read_strict

N = 1000
CHI2_95_OF_3 = 7.814727903251179  # published quantile
ENCODER_RAD, CONTACT_MM, TRIGGER_S = 6e-6, 0.004, 2e-4
PERIOD_NS = 10_000_000

SIMULATION = f"""\
schema = "traverse/simulator/1"
seed = 5
start = "first_start"
[arm]
file = "plain.toml"
noise_rad = {ENCODER_RAD}
[[device]]
id = "base"
port = "board.pty"
{SWEEP}
[[motion]]
kind = "cone"
artefact = "seat"
seat_mm = [600.0, -150.0, 60.0]
postures = 12
"""


class NoisyArm:
    def __init__(self, folder):
        self.rng = np.random.default_rng(1)
        arm = read_arm(DEMO_ARM)
        write_arm(folder / "plain.toml", arm)
        config_file = folder / "simulator.toml"
        config_file.write_text(SIMULATION, "utf-8")
        config = read_strict(config_file, SimulatorConfig, config_problems)
        simulated = build_arm(config, folder, "simulator.toml")
        script = build_script(config, simulated, folder, "simulator.toml")
        self.script = script
        self.course = build_course(config, simulated, script)
        self.encoders = encoders_of(config.device[0], arm, ENCODER_RAD)
        # Uncertainty of the arm: some combinations of its parameters.
        names = parameter_names([joint.name for joint in arm.joints], ())
        scales = np.where(["axis" in name for name in names], 4e-6, 0.004)
        factor = scales[:, np.newaxis] * self.rng.normal(size=(len(names), 12)) / 3.0
        file = folder / "arm.cov.npz"
        np.savez(file, names=np.array(names), covariance=factor @ factor.T)
        known = Identification(
            covariance_file=file.name,
            covariance_digest=hashlib.sha256(file.read_bytes()).hexdigest(),
        )
        write_arm(folder / "arm.toml", arm.model_copy(update={"identification": known}))
        self.clock = SetClock()
        settings = UncertaintySection(
            encoder_rad=ENCODER_RAD, contact_mm=CONTACT_MM, trigger_s=TRIGGER_S
        )
        self.daemon = Daemon(folder / "arm.toml", self.clock, settings)
        self.model = self.daemon.model
        moduli = tuple(map(int, self.encoders.moduli))
        board = Identity("board", "", moduli, 2, 1000.0, boot="1")
        self.daemon.take(None, DeviceUp("base", board, restarted=False))

    def counts(self, times_s):
        readings_rad = self.course.readings_rad(np.asarray(times_s))
        return self.encoders.counts(readings_rad, self.rng)

    def another_model(self):
        """The daemon's arm, with errors within its file's covariance."""
        geometry, joints = self.model.geometry, self.model.geometry.n_joints
        factor = self.model.covariance.factor
        off = factor @ self.rng.normal(size=factor.shape[1])
        axes = geometry.axes + off[: 3 * joints].reshape(-1, 3)
        links_mm = geometry.links_mm + off[3 * joints : 6 * joints].reshape(-1, 3)
        changed = replace(
            geometry,
            axes=axes / np.linalg.norm(axes, axis=1, keepdims=True),
            links_mm=links_mm,
            probe_vector_mm=geometry.probe_vector_mm + off[6 * joints :][:3],
            origin_mm=geometry.origin_mm + off[-3:],
        )
        return replace(self.model, geometry=changed)

    def touched(self, number, time_s):
        """Return the daemon's point of a touch, and the ball's true place."""
        self.daemon.use_model(self.another_model())
        latch_ns = 10**12 + number * 10**9
        before_ns = latch_ns - np.array([2, 1]) * PERIOD_NS - 1_000_000
        times_s = time_s + (before_ns - latch_ns) * 1e-9
        self.clock.now_ns = latch_ns + 1_000_000
        counts = self.counts(times_s)
        self.daemon.take(
            None,
            CountSamples(
                "base",
                1,
                np.array([2, 3]) * number + 2,
                before_ns // 1000,
                self.clock.now_ns,
                before_ns,
                np.zeros(2, np.uint8),
                counts.astype(np.uint32),
                np.zeros(counts.shape, np.uint8),
            ),
        )
        late_s = TRIGGER_S * self.rng.normal()
        (latched,) = self.counts([time_s + late_s]).tolist()
        self.daemon.take(
            Deaf(),
            LatchedCounts(
                "base",
                1,
                True,
                number,
                latch_ns // 1000,
                self.clock.now_ns,
                latch_ns,
                tuple(latched),
                (0,) * len(latched),
            ),
        )
        (true_mm,), _ = self.course.probe(np.array([time_s]))
        return self.daemon.points[-1], true_mm + CONTACT_MM * self.rng.normal(size=3)


class Deaf:
    def acknowledge(self, token):
        pass


def times_of(script, rng, *, moving):
    """Instants of the script at which the arm moves, or rests, (N,)."""
    drawn_s = np.sort(rng.uniform(0.1, script.duration_s - 0.1, 20 * N))
    around = [np.abs(script.speeds(drawn_s + step)).max(axis=1) for step in (-0.03, 0)]
    chosen = np.minimum(*around) > 0.02 if moving else np.maximum(*around) == 0.0
    return rng.choice(drawn_s[chosen], N)


@pytest.mark.slow
@pytest.mark.parametrize("moving", [False, True])
def test_95_of_100_points_lie_where_they_say(tmp_path, moving):
    arm = NoisyArm(tmp_path)
    distances, volumes = [], []
    times_s = times_of(arm.script, arm.rng, moving=moving)
    for number, time_s in enumerate(times_s.tolist()):
        point, true_mm = arm.touched(number, time_s)
        xx, xy, xz, yy, yz, zz = point.covariance_mm2
        stated = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        off_mm = np.array(point.xyz_mm) - true_mm
        distances.append(off_mm @ np.linalg.solve(stated, off_mm))
        volumes.append(np.linalg.det(stated))
    assert len(arm.daemon.points) == N
    inside = float(np.mean(np.array(distances) < CHI2_95_OF_3))
    assert 0.93 < inside < 0.97
    assert abs(np.mean(distances) - 3.0) < 0.25
    assert min(volumes) > 0.0
