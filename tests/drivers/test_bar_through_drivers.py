"""One motion of one arm, read by every driver: the bar has the same length."""

import pytest

from benchmarks.drivers.bar import measured_virtually
from benchmarks.drivers.bar_devices import BY_NAME

# A bus has no virtual time; tests/end_to_end/devices/test_canopen_arm.py reads one.
NAMES = [name for name in BY_NAME if name != "canopen"]


@pytest.mark.parametrize(
    "name",
    [NAMES[0], *(pytest.param(name, marks=pytest.mark.slow) for name in NAMES[1:])],
)
def test_a_bar_has_its_length_within_what_rounding_makes(name, tmp_path):
    measured = measured_virtually(BY_NAME[name], 4, tmp_path, asked_hz=50.0)
    assert abs(measured.off_mm) < 3.0 * measured.rounding_mm
    # What the counts of this make are worth at a reach of a metre.
    step_mm = 1000.0 * 2.0 * 3.1416 / 2 ** BY_NAME[name].bits
    assert 0.1 * step_mm < measured.noise_mm < 3.0 * step_mm
