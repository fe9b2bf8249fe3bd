"""Random numbers for every purpose; time, warmth, speed and force of contacts."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Floats
from traverse.simulator.campaigns.spec import ConditionTable

Purpose = Literal[
    "placement", "contacts", "conditions", "encoders", "touch", "certificates",
    "directions", "blunders", "sizes", "orientations",
]  # fmt: skip

_TAGS: dict[Purpose, int] = {
    "placement": 0x706C,
    "contacts": 0x636F,
    "conditions": 0x6364,
    "encoders": 0x656E,
    "touch": 0x746F,
    "certificates": 0x6365,
    "directions": 0x6469,
    "blunders": 0x626C,
    "sizes": 0x7369,
    "orientations": 0x6F72,
}


def stream(seed: int, purpose: Purpose) -> np.random.Generator:
    """Random numbers that no other purpose of the same seed shares.

    So that, say, more blunders leave every other drawn value as it was.
    """
    return np.random.default_rng([seed, _TAGS[purpose]])


JITTER = 0.4  # of the interval from pose to pose, either way


@dataclass(frozen=True, slots=True)
class Conditions:
    """Of every contact.

    Attributes:
        time_s: (n,) rising from 0.
        temperature_c: (n,)
        approach: (n, n_joints) -1 or +1, sense of the last motion. It is drawn: the
            last motion before a contact is a small one of the hand, whichever way the
            arm came.
        speed_rad_s: (n, n_joints) in that sense.
        force_n: (n,)
    """

    time_s: Floats
    temperature_c: Floats
    approach: NDArray[np.int8]
    speed_rad_s: Floats
    force_n: Floats


def drawn_conditions(
    table: ConditionTable, n_poses: int, n_joints: int, rng: np.random.Generator
) -> Conditions:
    """Draw the conditions of poses in the order of time."""
    gaps_s = table.interval_s * rng.uniform(1.0 - JITTER, 1.0 + JITTER, n_poses)
    time_s = np.cumsum(gaps_s) - gaps_s[0]
    cycles, phase = rng.uniform(0.5, 1.5), rng.uniform(0.0, 1.0)
    progress = time_s / max(float(time_s[-1]), table.interval_s)
    swing = np.sin(2.0 * np.pi * (cycles * progress + phase))
    senses = rng.integers(0, 2, (n_poses, n_joints), dtype=np.int8)
    temperature_c = table.temperature_c + table.swing_c * swing
    temperature_c += table.drift_c * (progress - 0.5)
    approach = (2 * senses - 1).astype(np.int8)
    speeds = np.abs(rng.standard_normal((n_poses, n_joints)))
    force_n = table.force_n * np.exp(table.force_spread * rng.standard_normal(n_poses))
    return Conditions(
        time_s=time_s,
        temperature_c=temperature_c,
        approach=approach,
        speed_rad_s=table.speed_rad_s * speeds * approach + 0.0,  # no -0.0
        force_n=force_n,
    )
