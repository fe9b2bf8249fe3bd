import pytest

from tests.fleet.chaos import Members, chaos
from traverse.testing.waiting import until


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
async def test_many_arms_and_three_members(make_mosquitto, postgres, tmp_path):
    result = await chaos(
        make_mosquitto(), postgres, tmp_path, n_arms=16, n_members=3, n_kills=10, seed=3
    )
    check(result)
    assert len(result.kills) == 3


@pytest.mark.slow
@pytest.mark.needs("mosquitto", "postgresql")
async def test_a_member_that_waits_for_its_name_outlives_the_database(
    make_mosquitto, postgres, tmp_path
):
    members = Members(make_mosquitto(), postgres.url, tmp_path, 1)
    await members.are_connected()
    members.kill(0)  # its claim of the name stays for some seconds
    members.start(0)
    await until(lambda: "a member called m0 is there" in members.log(0), "the claim")
    postgres.kill()
    await until(lambda: "this tries again" in members.log(0), "the loss", 30.0)
    postgres.start()
    await until(lambda: members.log(0).count("connected to") == 2, "the name", 30.0)
    assert members.stop() == [0]
    assert "Traceback" not in members.log(0)
