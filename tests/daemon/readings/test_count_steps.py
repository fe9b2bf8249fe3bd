"""Counts of encoders that resolve less than they count."""

import numpy as np
import pytest

from tests.daemon.values import SetClock, arm_model
from traverse.daemon.config.schema import UncertaintySection
from traverse.daemon.monitoring.events import EventLog
from traverse.daemon.pose.uncertainty import CovarianceEvaluator, CovarianceInput
from traverse.daemon.readings.count_steps import CountStepMonitor
from traverse.drivers.base.values import (
    STATUS_MISSING,
    CountSamples,
    DeviceUp,
    Identity,
)
from traverse.kinematics.effects.base.block import Block

IDENTITY = Identity("board", "", (1 << 20,) * 3, 0, 1000.0)


class Encoders:
    """Three encoders that a test reads."""

    def __init__(self, model) -> None:
        self.model, self.events, self.n = model, [], 0
        self.monitor = CountStepMonitor(model, EventLog(SetClock(), self.events.append))
        self.monitor.on_up(DeviceUp("base", IDENTITY, restarted=False))

    def read(self, counts, status=0) -> None:
        """Read (n, 3) counts, one each 10 ms."""
        for row in np.asarray(counts):
            self.n += 1
            time_ns = np.array([self.n * 10_000_000])
            self.monitor.add(
                CountSamples(
                    "base",
                    1,
                    np.array([self.n]),
                    time_ns,
                    int(time_ns[0]),
                    time_ns,
                    np.zeros(1, np.uint8),
                    row[np.newaxis].astype(np.uint32),
                    np.full((1, 3), status, np.uint8),
                )
            )

    @property
    def reported(self) -> list[tuple[bool | None, str]]:
        return [(event.active, event.text) for event in self.events]


@pytest.fixture
def encoders(tmp_path):
    return Encoders(arm_model(tmp_path))


def waving(rows=300):
    """A motion of a hand: (n, 3) counts, in no regular steps."""
    times_s = np.arange(rows)[:, np.newaxis] * 0.01
    phases = np.array([0.0, 1.0, 2.0])
    return np.rint(5e5 + 3e4 * np.sin(1.3 * times_s + phases)).astype(np.int64)


def test_an_encoder_of_fewer_bits_is_known_by_its_counts(encoders):
    counts = waving()
    counts[:, 1] = counts[:, 1] // 4 * 4
    encoders.read(counts)
    joint = encoders.model.channels.tolist().index(1)
    assert encoders.monitor.steps_counts[joint] == 4.0
    assert encoders.monitor.steps_counts.sum() == 6.0
    ((active, text),) = encoders.reported
    assert active
    assert f"J{joint + 1} changes by 4 of" in text
    # Its successor, of all bits, makes itself known likewise.
    encoders.read(waving())
    assert encoders.monitor.steps_counts.tolist() == [1.0, 1.0, 1.0]
    assert [active for active, _ in encoders.reported] == [True, False]


def test_single_spoilt_counts_hide_nothing(encoders):
    counts = waving(600) // 4 * 4
    counts[::97] += 1
    encoders.read(counts)
    assert encoders.monitor.steps_counts.tolist() == [4.0, 4.0, 4.0]


def test_fine_encoders_are_never_coarse(encoders):
    encoders.read(waving(3000))
    resting = waving(1) + np.random.default_rng(1).integers(-1, 2, (500, 3))
    encoders.read(resting)
    # A script leads an arm by as much each time; so does nothing else.
    encoders.read(1000 + np.arange(300)[:, np.newaxis] * [7, 16, 300])
    # Counts that were not read are not those of the encoder.
    encoders.read(waving() // 8 * 8, status=STATUS_MISSING)
    assert encoders.monitor.steps_counts.tolist() == [1.0, 1.0, 1.0]
    assert encoders.reported == []


def test_a_device_states_what_its_words_resolve(encoders):
    stated = Identity(
        "lines", "", (1 << 20,) * 3, 0, 100.0, steps_counts=(1.0, 104.3, 1.0)
    )
    encoders.monitor.on_up(DeviceUp("base", stated, restarted=False))
    encoders.read(waving())
    joint = encoders.model.channels.tolist().index(1)
    assert encoders.monitor.steps_counts[joint] == 104.3
    assert f"J{joint + 1} changes by 104.3" in encoders.reported[0][1]


def test_the_state_of_a_recording_is_continued_alike(encoders):
    counts = waving(200) // 8 * 8
    encoders.read(counts[:100])
    other = Encoders(encoders.model)
    other.monitor.resume(encoders.monitor.state)
    other.n = encoders.n
    for each in (encoders, other):
        each.read(counts[100:130])
    assert other.monitor.state == encoders.monitor.state
    assert other.monitor.steps_counts.tolist() == [8.0, 8.0, 8.0]


def test_covariances_hold_the_steps(encoders):
    model = encoders.model
    settings = UncertaintySection(encoder_rad=0.0, contact_mm=0.0)
    evaluator = CovarianceEvaluator(settings, encoders.monitor)
    reading = CovarianceInput(Block(np.zeros((1, 3))), np.zeros((1, 3)))
    before = np.array(evaluator.covariance(model, reading).own_mm2)
    encoders.read(waving() // 16 * 16)
    after = np.array(evaluator.covariance(model, reading).own_mm2)
    # A rounded value is spread evenly over a step, with its square / 12 as variance;
    # the arm's own covariance is tiny.
    np.testing.assert_allclose(after, 16.0**2 * before, rtol=1e-5)
