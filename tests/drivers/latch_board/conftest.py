import pytest

from tests.drivers.latch_board.rig import board_rig


@pytest.fixture
async def rig(tmp_path):
    with board_rig(tmp_path) as rig:
        yield rig
