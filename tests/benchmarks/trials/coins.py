import os
from functools import partial

import numpy as np

from benchmarks.trials.lines import outcomes
from benchmarks.trials.program import Program, Verdict
from benchmarks.trials.series import Series

DEADLY = 13


def thrown(bias, seed):
    return seed, np.random.default_rng(seed).random(10) < bias


def count(case):
    """Count heads; refuse seed 7, and die of seed 13."""
    seed, heads = case
    if seed == 7:
        raise ValueError("this coin\nis on its edge")
    if seed == DEADLY:
        os._exit(1)
    return {"outcome": {"heads": int(heads.sum()), "nothing": float("nan")}}


def series(_asked=None):
    return [
        Series("fair", partial(thrown, 0.5), count, 6, batch=2),
        Series("loaded", partial(thrown, 0.9), count, 2, first=100),
    ]


def judge(lines):
    means = {
        name: np.mean([each["heads"] for each in outcomes(lines, name)])
        for name in dict.fromkeys(line["scenario"] for line in lines)
        if outcomes(lines, name)
    }
    holds = means.get("fair", 0.0) < means.get("loaded", 10.0)
    return Verdict(f"heads: {means}", holds)


COINS = Program("benchmarks.coins", series, judge)
