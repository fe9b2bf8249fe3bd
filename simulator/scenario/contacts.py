"""Where the touched material is, all along a course."""

from dataclasses import dataclass

import numpy as np

from traverse.simulator.arm.physics import Floats
from traverse.simulator.scenario.script import Script, ScriptEvent

HOLD_S = 0.1  # before and after a change of an input the direction stands
SHARE = 0.25  # of the time to the next change, at most


@dataclass(frozen=True, slots=True)
class ContactDirections:
    """Directions from the ball towards the material that it touches or is led to.

    Between two contacts they shrink to nothing and grow again, so that what depends
    on them comes and goes without a jump.

    Attributes:
        knots_s: (m,) rising, within the script.
        towards: (m, 3) there; linear in between.
        loop_s: Duration of the script if it repeats, None if it ends.
    """

    knots_s: Floats
    towards: Floats
    loop_s: float | None

    def at(self, script_s: Floats) -> Floats:
        """Directions (n, 3) at times (n,) of the script; not longer than 1."""
        if self.loop_s is not None:
            script_s = script_s % self.loop_s
        columns = [np.interp(script_s, self.knots_s, c) for c in self.towards.T]
        return np.stack(columns, axis=1)


def contact_directions(script: Script) -> ContactDirections:
    """Find them from the changes of inputs, which happen in contact."""
    knots_s, towards = [0.0], [np.zeros(3)]
    nexts = (*script.events[1:], None)
    for event, next_ in zip(script.events, nexts[: len(script.events)], strict=True):
        end_s = script.duration_s if next_ is None else next_.time_s
        here = _towards(event)
        before_s = min(HOLD_S, SHARE * (event.time_s - knots_s[-1]))
        knots_s += [event.time_s - before_s, event.time_s]
        towards += [here, here]
        if next_ is not None and np.array_equal(here, _towards(next_)):
            continue
        after_s = min(HOLD_S, SHARE * (end_s - event.time_s))
        knots_s += [event.time_s + after_s, 0.5 * (event.time_s + end_s)]
        towards += [here, np.zeros(3)]
    return ContactDirections(
        np.array(knots_s),
        np.array(towards),
        script.duration_s if script.repeat else None,
    )


def _towards(event: ScriptEvent) -> Floats:
    return np.zeros(3) if event.normal is None else -np.array(event.normal)
