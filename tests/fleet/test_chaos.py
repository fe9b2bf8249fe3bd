"""Nothing is lost and nothing counts twice, whatever dies."""

import pytest

from tests.fleet.chaos import chaos


def check(result):
    assert (result.lost, result.doubled, result.invented) == (0, 0, 0), result
    assert (result.incomplete, result.written_off) == ([], 0), result


@pytest.mark.needs("mosquitto")
@pytest.mark.slow
async def test_members_of_one_computer_share_a_file(make_mosquitto, tmp_path):
    result = await chaos(
        make_mosquitto(), None, tmp_path, n_arms=3, n_members=2, n_kills=3, seed=2
    )
    check(result)


@pytest.mark.slow
@pytest.mark.needs("mosquitto", "postgresql")
async def test_fifty_arms_and_three_members(make_mosquitto, postgres, tmp_path):
    result = await chaos(
        make_mosquitto(), postgres, tmp_path, n_arms=50, n_members=3, n_kills=20, seed=3
    )
    check(result)
    assert len(result.kills) == 3
