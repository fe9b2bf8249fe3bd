"""True course of the arm with its faults along a script.

The operator watches the ball and compensates for deflections, so that the ball moves as
in the script. These corrections of the turns are small and smooth: they are solved
every 10 ms and interpolated. The truth log is computed from the resulting turns, so
that it is exact.
"""

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from traverse.arrays import Floats
from traverse.simulator.arm.physics import probe_pose
from traverse.simulator.effects import FaultyArm, Surroundings
from traverse.simulator.scenario.script import Script, ScriptEvent
from traverse.strict_toml.reader import StrictModel

HOLD_S = 0.1  # before and after a change of an input the direction is constant
SHARE = 0.25  # of the time to the next change, at most
STEP_S = 0.01
CHUNK_STEPS = 256
N_CHUNKS = 4  # that are kept; several boards look at the same times
FORCE_N = 1.0  # of every contact


class ClimateTable(StrictModel):
    """A temperature that drifts and swings.

    Attributes:
        temperature_c: of the arm at the start of the script.
        drift_c_s: rise in a second, for ever.
    """

    temperature_c: float = 20.0
    drift_c_s: float = 0.0
    swing_c: float = Field(default=0.0, ge=0.0)
    swing_period_s: float = Field(default=3600.0, gt=0.0)

    def change_c(self, script_s: Floats) -> Floats:
        waves: Floats = np.sin(2.0 * np.pi / self.swing_period_s * script_s)
        return self.drift_c_s * script_s + self.swing_c * waves


@dataclass(frozen=True, slots=True)
class ContactDirections:
    """Directions from the ball towards the material that it touches or is led to.

    Between two contacts they shrink to nothing and grow again, so that what depends on
    them changes without a jump.

    Attributes:
        knots_s: (m,) rising, within the script.
        towards: (m, 3) there; linear in between.
        loop_s: duration of the script if it repeats, None if it ends.
    """

    knots_s: Floats
    towards: Floats
    loop_s: float | None

    def at(self, script_s: Floats) -> Floats:
        """Return directions (n, 3) at script times (n,); not longer than 1."""
        if self.loop_s is not None:
            script_s = script_s % self.loop_s
        columns = [np.interp(script_s, self.knots_s, c) for c in self.towards.T]
        return np.stack(columns, axis=1)


def contact_directions(script: Script) -> ContactDirections:
    """Derive directions from the changes of inputs, which happen in contact."""
    knots_s, towards = [0.0], [np.zeros(3)]
    nexts = (*script.events[1:], None)
    for event, next_ in zip(script.events, nexts[: len(script.events)], strict=True):
        end_s = script.duration_s if next_ is None else next_.time_s
        direction = _towards(event)
        before_s = min(HOLD_S, SHARE * (event.time_s - knots_s[-1]))
        knots_s += [event.time_s - before_s, event.time_s]
        towards += [direction, direction]
        if next_ is not None and np.array_equal(direction, _towards(next_)):
            continue
        after_s = min(HOLD_S, SHARE * (end_s - event.time_s))
        knots_s += [event.time_s + after_s, 0.5 * (event.time_s + end_s)]
        towards += [direction, np.zeros(3)]
    return ContactDirections(
        np.array(knots_s),
        np.array(towards),
        script.duration_s if script.repeat else None,
    )


def _towards(event: ScriptEvent) -> Floats:
    return np.zeros(3) if event.normal is None else -np.array(event.normal)


class Course:
    """The arm over the time of a script."""

    def __init__(
        self, script: Script, arm: FaultyArm, climate: ClimateTable, start_utc_s: float
    ) -> None:
        self._script = script
        self._arm = arm
        self._climate = climate
        self._start_utc_s = start_utc_s
        self._contacts = contact_directions(script)
        self._corrections: OrderedDict[int, Floats] = OrderedDict()

    def readings_rad(self, script_s: Floats) -> Floats:
        """Return readings (n, n_joints) at script times (n,)."""
        turns_rad = self.turns_rad(script_s)
        if not self._arm.readings:
            build = self._arm.build
            return build.encoders_of(turns_rad) + build.zeros_rad
        return self._arm.readings_rad(turns_rad, self._around(script_s))

    def probe(self, script_s: Floats) -> tuple[Floats, Floats]:
        """Return true ball centres and shank directions, (n, 3) each."""
        return self._arm.probe(self.turns_rad(script_s), self._around(script_s))

    def turns_rad(self, script_s: Floats) -> Floats:
        scripted_rad = self._script.turns(script_s)
        if self._arm.is_stiff:
            return scripted_rad
        return scripted_rad + self._interpolated(script_s)

    def _around(self, script_s: Floats) -> Surroundings:
        temperature_c = self._climate.temperature_c + self._climate.change_c(script_s)
        return Surroundings(
            time_s=script_s,
            utc_s=self._start_utc_s + script_s,
            temperature_c=temperature_c,
            speed_rad_s=self._arm.build.encoders_of(self._script.speeds(script_s)),
            approach=self._script.senses(script_s),
            towards=self._contacts.at(script_s),
            force_n=np.full(len(script_s), FORCE_N),
        )

    def _interpolated(self, script_s: Floats) -> Floats:
        """Return corrections (n, n_joints): cubics through four neighbours."""
        steps = script_s / STEP_S
        below = np.floor(steps).astype(np.int64)
        u = (steps - below)[:, None]
        weights = (
            -u * (u - 1.0) * (u - 2.0) / 6.0,
            (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0,
            -(u + 1.0) * u * (u - 2.0) / 2.0,
            (u + 1.0) * u * (u - 1.0) / 6.0,
        )
        chunks, first = np.divmod(below, CHUNK_STEPS)
        turns_rad = np.empty((len(script_s), len(self._arm.build.zeros_rad)))
        for chunk in np.unique(chunks).tolist():
            rows = chunks == chunk
            known = self._chunk(chunk)
            total = np.zeros_like(turns_rad[rows])
            for ahead, weight in enumerate(weights):
                total += weight[rows] * known[first[rows] + ahead]
            turns_rad[rows] = total
        return turns_rad

    def _chunk(self, chunk: int) -> Floats:
        """Corrections (CHUNK_STEPS + 3, n_joints) from one step before it."""
        known = self._corrections.get(chunk)
        if known is None:
            steps = chunk * CHUNK_STEPS + np.arange(-1, CHUNK_STEPS + 2)
            times_s = STEP_S * np.maximum(steps, 0)
            scripted_rad = self._script.turns(times_s)
            wanted_mm, _ = probe_pose(self._arm.build.mechanism, scripted_rad)
            led_rad = self._arm.led_turns(
                scripted_rad, wanted_mm, self._around(times_s)
            )
            known = led_rad - scripted_rad
            self._corrections[chunk] = known
            if len(self._corrections) > N_CHUNKS:
                self._corrections.popitem(last=False)
        return known
