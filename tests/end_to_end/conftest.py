from pathlib import Path

import pytest

from tests.end_to_end.workbench import REST, Workbench
from tests.mosquitto import Mosquitto


@pytest.fixture
def bench(mosquitto: Mosquitto, tmp_path: Path) -> Workbench:
    """Files for an arm that reports to the broker which all tests share."""
    return Workbench(tmp_path, mosquitto.host, mosquitto.port)


@pytest.fixture
def resting(bench: Workbench) -> Workbench:
    bench.write_simulator(REST)
    bench.write_daemon()
    return bench
