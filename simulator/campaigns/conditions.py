"""Random numbers by purpose; time, temperature, speed and force of contacts."""

from typing import Literal

import numpy as np

from traverse.arrays import Floats
from traverse.simulator.campaigns.spec import ConditionTable
from traverse.simulator.effects import Surroundings

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
    """Return a generator for one purpose of a seed.

    More blunders, say, leave every other drawn value as it was.
    """
    return np.random.default_rng([seed, _TAGS[purpose]])


JITTER = 0.4  # of the interval from pose to pose, either way


def temperatures_c(
    table: ConditionTable, progress: Floats, rng: np.random.Generator
) -> Floats:
    """Draw temperatures (n,): a wave and a drift over the progress, from 0 to 1."""
    cycles, phase = rng.uniform(0.5, 1.5), rng.uniform(0.0, 1.0)
    swing = np.sin(2.0 * np.pi * (cycles * progress + phase))
    temperature_c = table.temperature_c + table.swing_c * swing
    return temperature_c + table.drift_c * (progress - 0.5)


def drawn_conditions(
    table: ConditionTable, n_poses: int, n_joints: int, rng: np.random.Generator
) -> Surroundings:
    """Draw conditions of contacts in the order of time, with unknown directions.

    The direction of the last motion is drawn: it is a small one of the hand, however
    the arm came. Speeds have its sign.
    """
    gaps_s = table.interval_s * rng.uniform(1.0 - JITTER, 1.0 + JITTER, n_poses)
    time_s = np.cumsum(gaps_s) - gaps_s[0]
    progress = time_s / max(float(time_s[-1]), table.interval_s)
    temperature_c = temperatures_c(table, progress, rng)
    senses = rng.integers(0, 2, (n_poses, n_joints), dtype=np.int8)
    approach = 2.0 * senses.astype(np.float64) - 1.0
    speeds = np.abs(rng.standard_normal((n_poses, n_joints)))
    forces = np.exp(table.force_spread * rng.standard_normal(n_poses))
    start = table.start_utc
    return Surroundings(
        time_s=time_s,
        utc_s=None if start is None else start.timestamp() + time_s,
        temperature_c=temperature_c,
        speed_rad_s=table.speed_rad_s * speeds * approach + 0.0,  # no -0.0
        approach=approach,
        towards=np.full((n_poses, 3), np.nan),
        force_n=table.force_n * forces,
    )
