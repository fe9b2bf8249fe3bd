"""What the arm with its faults really does while it is led along a script.

Who leads it sees where the ball is: a joint that yields is made up for, so that the
ball goes where the script wants it. These corrections of the turns are small and
smooth: they are found every 10 ms and interpolated in between. What is told as true is
computed from the turns that come out, so it is true whatever the interpolation leaves.
"""

from collections import OrderedDict

import numpy as np

from traverse.simulator.arm.physics import Floats, probe_pose
from traverse.simulator.effects import FaultyArm, Surroundings
from traverse.simulator.scenario.climate import ClimateTable
from traverse.simulator.scenario.contacts import contact_directions
from traverse.simulator.scenario.script import Script

STEP_S = 0.01
CHUNK_STEPS = 256
N_CHUNKS = 4  # that are kept; several boards look at the same times
FORCE_N = 1.0  # of every contact


class Course:
    """The arm over the time of a script.

    Args:
        script: What it is led along.
        arm: As it is.
        climate: How warm it is.
        start_utc_s: When the script begins, since 1970.
    """

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
        """What the encoders show, (n, n_joints), at times (n,)."""
        turns_rad = self.turns_rad(script_s)
        if not self._arm.readings:
            return turns_rad + self._arm.build.zeros_rad
        return self._arm.readings_rad(turns_rad, self._around(script_s))

    def probe(self, script_s: Floats) -> tuple[Floats, Floats]:
        """Centres of the ball (n, 3) and directions of the shank (n, 3), true ones."""
        return self._arm.probe(self.turns_rad(script_s), self._around(script_s))

    def turns_rad(self, script_s: Floats) -> Floats:
        """True turns of the hinges, (n, n_joints)."""
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
            speed_rad_s=self._script.speeds(script_s),
            approach=self._script.senses(script_s),
            towards=self._contacts.at(script_s),
            force_n=np.full(len(script_s), FORCE_N),
        )

    def _interpolated(self, script_s: Floats) -> Floats:
        """Corrections (n, n_joints): cubics through four neighbours."""
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
        found = np.empty((len(script_s), len(self._arm.build.zeros_rad)))
        for chunk in np.unique(chunks).tolist():
            rows = chunks == chunk
            known = self._chunk(chunk)
            total = np.zeros_like(found[rows])
            for ahead, weight in enumerate(weights):
                total += weight[rows] * known[first[rows] + ahead]
            found[rows] = total
        return found

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
