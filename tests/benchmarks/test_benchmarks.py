"""Benchmarks run, at sizes too small to say anything, and refuse unequal results."""

import numpy as np
import pytest

from benchmarks.kinematics import COMPILED, Differences, arm, tables
from benchmarks.peers.installed import check_agreement
from benchmarks.peers.peer import Peer
from benchmarks.tools.rounds import Task, timed
from traverse.kinematics.model.derivatives import numpy_derivatives
from traverse.kinematics.model.forward import numpy_centre

compiled = pytest.mark.skipif(not COMPILED, reason="the kernel in C is not built")


@pytest.mark.slow
@compiled
def test_kernel_is_timed_beside_numpy_and_peers():
    single, batch, jacobian = tables(n_samples=64, n_derived=8, rounds=2)

    assert {f"{name}, pose" for name in COMPILED} <= single.times_s.keys()
    assert {f"{name}, centre" for name in COMPILED} <= batch.times_s.keys()
    assert set(COMPILED) <= jacobian.times_s.keys()
    assert jacobian.peers == ("differences",)
    for table in (single, batch, jacobian):
        assert all(len(times) == 2 for times in table.times_s.values())
        assert len(table.lines()) == 1 + len(table.times_s)


@compiled
def test_differences_are_those_derivatives():
    angles_rad = np.random.default_rng(5).uniform(-3, 3, (4, 7))
    differences = Differences(arm(), COMPILED[0], angles_rad).compute()

    exact = numpy_derivatives(arm(), angles_rad)
    flat = np.concatenate(
        [
            exact.by_angles.transpose(2, 0, 1),
            exact.by_axes.transpose(2, 3, 0, 1).reshape(21, 4, 3),
            exact.by_links.transpose(2, 3, 0, 1).reshape(21, 4, 3),
        ]
    )
    # The reach is 2 m: differences of 1e-6 are good to a few units of 1e-3 there.
    np.testing.assert_allclose(differences, flat, atol=5e-3)


def test_peer_that_computes_another_arm_is_refused():
    geometry = arm()
    angles_rad = np.random.default_rng(6).uniform(-3, 3, (5, 7))

    def shifted(turns_rad):
        return numpy_centre(geometry, turns_rad + geometry.zeros_rad) + 1e-6

    with pytest.raises(ValueError, match="1e-06 mm off the definition"):
        check_agreement(geometry, Peer("other", "1", batch=shifted), angles_rad)


def test_ratio_is_to_the_fastest_peer():
    tasks = [Task("ours", int), Task("fast", int, 2, True), Task("slow", int, 1, True)]
    table = timed("nothing", tasks, rounds=3)
    table.times_s.update(ours=[1.0, 1.0, 1.0], fast=[2.0, 4.0, 3.0], slow=[9.0] * 3)

    assert table.reference == "fast"
    assert table.ratios("ours") == pytest.approx((3.0, 2.2, 3.8))
    assert table.ratios("fast") == (1.0, 1.0, 1.0)
