"""For every row of the table: what takes it away, and what the remedy does."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from tests.daemon.arm_harness import ArmBench, edge
from tests.daemon.board_harness import BOARD, Bench
from tests.daemon.effect_entries import effect
from tests.daemon.two_devices import BEGIN_NS
from tests.daemon.values import ARM as ARM_TEXT
from tests.daemon.values import arm_file, arm_model, count_samples, latch
from traverse.daemon.conditions.table import BY_NAME, CONDITIONS, Condition
from traverse.daemon.config.schema import QualitySection
from traverse.daemon.executor import ConfirmReference
from traverse.daemon.pose.arm_model import read_model
from traverse.daemon.reports import status_message
from traverse.drivers.base.values import (
    STATUS_ERROR,
    STATUS_TIME_UNCERTAIN,
    DeviceLost,
    DeviceTemperatures,
    DeviceUp,
    StreamStarted,
)
from traverse.protocol.messages import ReferenceArgs, flag_names

UP = DeviceUp("base", BOARD, restarted=False)
DAY_NS = 86_400 * 10**9
HERE = (1000, 1000, 1000)
CURVE = effect(
    "empirical",
    joint='"J2"',
    covariate='"J2_rad"',
    knots=[-1.0, 1.0],
    values_rad=[0.0, 1e-4],
)


class BoardWorld:
    """One board, whose arm rests; `flags` measures once more."""

    def __init__(self, folder, text=ARM_TEXT, **limits) -> None:
        limits.setdefault("refuse", ())
        quality = QualitySection(**limits)
        self.folder, self.text = folder, text
        self.bench = Bench(arm_model(folder, text), quality=quality)
        self.events, self.measurement = self.bench.events, self.bench.measurement
        self._n = 0
        self.counts, self.status = np.array(HERE), 0
        self.bench.take(UP)

    def flags(self):
        """Of a point, after samples for two seconds."""
        bench = self.bench
        for _ in range(10):
            start_ns = bench.clock.now_ns
            samples = replace(
                count_samples(
                    np.tile(self.counts, (20, 1)),
                    first=self._n,
                    start_ns=start_ns - self._n * 10**7,
                ),
                status=np.full((20, 3), self.status, np.uint8),
            )
            bench.clock.now_ns += 200_000_000
            self._n += 20
            bench.take(samples)
        self._press()
        return set(bench.points[-1].quality.flags)

    def _press(self):
        at_ns = self.bench.clock.now_ns - 10_000_000
        counts = tuple(self.counts.tolist())
        status = (self.status,) * 3
        self.bench.take(latch(counts, now_ns=at_ns, token=self._n, status=status))

    def move(self):
        for by in (2000, -2000):
            self.lead(self.counts + by)

    def lead(self, counts):
        """Turn joints within half a second."""
        path = np.rint(np.linspace(self.counts, counts, 50))
        first, start_ns = self._n, self.bench.clock.now_ns
        self.bench.take(
            count_samples(path, first=first, start_ns=start_ns - first * 10**7)
        )
        self._n += 50
        self.counts = np.array(counts)
        self.bench.clock.now_ns += 500_000_000

    def freeze(self):
        """Turn all joints, of which one stops between two samples."""
        path = self.counts + np.outer(np.arange(60) * 1000, (4, 40, 1))
        path[30:, 0] = path[30, 0]
        first, start_ns = self._n, self.bench.clock.now_ns
        self.bench.take(
            count_samples(path, first=first, start_ns=start_ns - first * 10**7)
        )
        self._n += 60
        self.counts = path[-1]
        self.bench.clock.now_ns += 600_000_000

    def repeat(self):
        """Turn a joint, of which two readings repeat the count before."""
        self._turn(1, repeated=(30, 45))

    def turn_long(self):
        """Turn it for long enough without."""
        for turn in range(21):
            self._turn((-1) ** turn)

    def _turn(self, sense, repeated=()):
        steps = np.tile([8, 0, 0], (100, 1)) * np.minimum(np.arange(100), 40)[:, None]
        path = self.counts + sense * np.cumsum(steps, axis=0)
        path[list(repeated)] = path[[row - 1 for row in repeated]]
        first, start_ns = self._n, self.bench.clock.now_ns
        self.bench.take(
            count_samples(path, first=first, start_ns=start_ns - first * 10**7)
        )
        self._n += 100
        self.counts = path[-1]
        self.bench.clock.now_ns += 1_000_000_000

    def close(self):
        self.bench.device.driver.close()


class TwoDeviceWorld:
    """An arm whose joints are read at different instants."""

    def __init__(self, folder) -> None:
        self.bench = ArmBench(folder, skew_limit_mm=1e-3)
        self.events, self.measurement = self.bench.events, self.bench.measurement
        self.bench.up()
        self._n, self.speed = 0, 0.0

    def flags(self):
        """Of the live poses of two seconds."""
        bench = self.bench
        end = self._n + 200
        for first in range(self._n, end, 20):
            bench.stream(first, first + 20, self.speed)
        self._n = end
        at_ns = BEGIN_NS + (end - 5) * 10_000_000 + 3_000_000
        bench.take(edge("handle", at_ns, token=end))
        bench.later(0.1)
        return set(bench.points[-1].quality.flags)

    def close(self):
        self.bench.close()


@dataclass(frozen=True)
class Plant:
    """How one condition is lost, and mended.

    Attributes:
        begin: makes the world.
        lose, mend: do it; a coroutine function is awaited.
    """

    begin: Callable
    lose: Callable
    mend: Callable


def take(*deliveries):
    return lambda world: world.bench.take(*deliveries)


def put(name, value):
    return lambda world: setattr(world, name, value)


async def confirm(world):
    await ConfirmReference(ReferenceArgs(action="confirm")).execute(world.measurement)


async def slow_down(world):
    world.speed = 3e-4
    world.flags()  # at another place at once, which has to be confirmed
    await confirm(world)


def unidentify(world):
    file = arm_file(world.folder, world.text)
    world.measurement.set_model(read_model(file, {"base": None}))


def identify_again(world):
    world.measurement.set_model(arm_model(world.folder, world.text))


def pass_days(days):
    def act(world):
        world.bench.clock.offset_ns += int(days * DAY_NS)
        world.flags()  # a step of the clock is marked for a second

    return act


def begin_identified(folder):
    world = BoardWorld(folder, identification_days=30.0)
    now_s = (world.bench.clock.now_ns + world.bench.clock.offset_ns) * 1e-9
    world.measurement.set_model(replace(world.measurement.model, identified_s=now_s))
    return world


def begin_warm(folder):
    warm = effect("encoder_temperature", joint='"J2"', rate_rad_c=1e-4)
    world = BoardWorld(folder, ARM_TEXT + warm)
    world.bench.take(DeviceTemperatures("base", (20.0,)))
    return world


def lose_temperature(world):
    world.bench.take(DeviceTemperatures("base", (None, 68.0)))  # degrees Fahrenheit
    world.bench.clock.now_ns += 6 * 10**9


def begin_with_play(folder):
    play = effect("backlash", joint='"J2"', half_width_rad=1e-6)
    world = BoardWorld(folder, ARM_TEXT + play)
    world.move()
    return world


def begin_with_a_curve(folder):
    world = BoardWorld(folder, ARM_TEXT + CURVE)
    world.measurement.references.confirm()  # the turn matters
    return world


def numbered(serial):
    return replace(UP, identity=replace(BOARD, serials=(serial,)))


def begin_numbered(folder):
    world = BoardWorld(folder)
    world.bench.take(numbered("AAA111"))
    world.measurement.references.confirm()
    return world


def lose_motion(world):
    world.measurement.pipeline.restart("base")


PLANTS = {
    "present": Plant(
        BoardWorld, take(DeviceLost("base", "unplugged", "plug it in")), take(UP)
    ),
    "readings": Plant(BoardWorld, put("status", STATUS_ERROR), put("status", 0)),
    "channels": Plant(BoardWorld, BoardWorld.freeze, BoardWorld.move),
    "single_readings": Plant(BoardWorld, BoardWorld.repeat, BoardWorld.turn_long),
    "identity": Plant(begin_numbered, take(numbered("BBB222")), confirm),
    "reference": Plant(BoardWorld, take(replace(UP, restarted=True)), confirm),
    "device_clock": Plant(
        BoardWorld, put("status", STATUS_TIME_UNCERTAIN), put("status", 0)
    ),
    "skew": Plant(TwoDeviceWorld, put("speed", 2.0), slow_down),
    "geometry": Plant(BoardWorld, unidentify, identify_again),
    "temperature": Plant(
        begin_warm, lose_temperature, take(DeviceTemperatures("base", (20.0,)))
    ),
    "motion": Plant(begin_with_play, lose_motion, BoardWorld.move),
    "effects": Plant(
        begin_with_a_curve,
        lambda world: world.lead((400_000, 1000, 1000)),
        lambda world: world.lead(HERE),
    ),
    "temperature_band": Plant(
        lambda folder: BoardWorld(folder, temperature_high_c=30.0),
        take(DeviceTemperatures("base", (35.0,))),
        take(DeviceTemperatures("base", (29.0,))),
    ),
    "identification_age": Plant(begin_identified, pass_days(40), pass_days(-40)),
    "utc": Plant(BoardWorld, pass_days(-17_000), pass_days(17_000)),
}
"""By name of the row."""


def standing(world, name):
    status = status_message(
        world.measurement, world.measurement.clock, "msgpack", keeps_points=True
    )
    (standing_of_name, *_) = [
        condition for condition in status.conditions if condition.name == name
    ]
    return status.state, standing_of_name


def test_every_row_has_a_plant():
    assert list(PLANTS) == [row.name for row in CONDITIONS]
    assert len(BY_NAME) == len(CONDITIONS)


@pytest.mark.parametrize("row", CONDITIONS, ids=lambda row: row.name)
async def test_a_lost_condition_marks_and_its_remedy_clears_it(
    row: Condition, tmp_path
):
    plant = PLANTS[row.name]
    world = plant.begin(tmp_path)
    try:
        if row.name == "temperature_band":
            plant.mend(world)
        remarks = {"interpolated", "empirical"}
        assert world.flags() <= remarks
        if isinstance(world, BoardWorld):
            assert standing(world, row.name)[0] == "ready"
        assert standing(world, row.name)[1].established

        plant.lose(world)
        flags = world.flags()
        assert flags & set(flag_names(int(row.flags))), flags
        state, lost = standing(world, row.name)
        assert state in ("doubt", "degraded")
        assert not lost.established
        assert lost.cause
        assert lost.remedy
        begun = [e for e in world.events if e.code == row.code and e.active]
        assert begun[-1].severity == row.severity
        assert lost.cause in begun[-1].text
        assert begun[-1].remedy

        mended = plant.mend(world)
        if mended is not None and hasattr(mended, "__await__"):
            await mended
        assert world.flags() <= remarks
        assert standing(world, row.name)[1].established
        ended = [e for e in world.events if e.code == row.code]
        assert ended[-1].active is False
    finally:
        world.close()


async def test_a_device_that_is_there_and_silent_has_no_recent_readings(tmp_path):
    world = BoardWorld(tmp_path)
    try:
        world.bench.take(StreamStarted("base", 1, 100.0, 100.0))
        world.flags()
        world.measurement.check_recent()
        assert standing(world, "readings")[1].established

        world.bench.clock.now_ns += 1_100_000_000
        world.measurement.check_recent()
        state, lost = standing(world, "readings")
        assert state == "doubt"
        assert lost.cause == "base is there and sends no readings"
        assert world.events[-1].code == "condition.readings"

        world.flags()
        assert standing(world, "readings")[1].established
    finally:
        world.close()
