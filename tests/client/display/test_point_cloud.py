"""Clouds of scanned points within a budget."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from traverse.client.display.point_cloud import Cloud


def kept(cloud: Cloud) -> np.ndarray:
    return np.frombuffer(cloud.bytes_from(0), "<f4").reshape(-1, 3)


@given(st.lists(st.integers(0, 70), max_size=40), st.sampled_from([2, 8, 32]))
def test_every_kth_point_of_all_is_kept_whatever_the_blocks(
    sizes: list[int], budget: int
) -> None:
    cloud = Cloud(budget)
    n = 0
    for size in sizes:
        cloud.add(np.repeat(np.arange(n, n + size, dtype=float)[:, np.newaxis], 3, 1))
        n += size
    assert cloud.n_seen == n
    assert cloud.n_kept <= budget
    expected = np.arange(0, n, cloud.every, dtype=np.float32)
    assert (kept(cloud)[:, 0] == expected).all()
    assert len(expected) == cloud.n_kept
    # It is thinned only when it must be.
    assert cloud.every == 1 or n > (budget - 1) * cloud.every // 2


def test_what_was_handed_out_holds_until_the_version_changes() -> None:
    cloud = Cloud(8)
    cloud.add(np.ones((5, 3)))
    version = cloud.version
    first = cloud.bytes_from(0)
    cloud.add(2.0 * np.ones((2, 3)))
    assert cloud.version == version
    assert cloud.bytes_from(0)[: len(first)] == first
    assert len(cloud.bytes_from(5)) == 2 * 12
    cloud.add(np.zeros((1, 3)))
    assert cloud.version != version


def test_another_scan_begins_anew() -> None:
    cloud = Cloud(8)
    cloud.add(np.ones((20, 3)))
    version = cloud.version
    cloud.clear()
    assert (cloud.n_kept, cloud.n_seen, cloud.every) == (0, 0, 1)
    assert cloud.version != version
