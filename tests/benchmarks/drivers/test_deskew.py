from benchmarks.drivers.deskew import measured
from benchmarks.drivers.moving_arm import Case


def test_interpolation_leaves_little_more_than_the_resolution_of_the_encoders():
    deskewed = measured(Case(0.0005, 0.0001, 100.0, sway_hz=0.5), seconds=1.5)
    # At 1 rad/s, up to 3.5 ms too late and a metre away: millimetres
    assert deskewed.rms_mm["as read"] > 0.8
    assert deskewed.rms_mm["interpolated"] < 1.2 * deskewed.rms_mm["latched"]
    # 14 bits: a sixth of a turn's 16384th part at each joint
    assert deskewed.rms_mm["latched"] < 0.25
    extra_mm2 = deskewed.rms_mm["interpolated"] ** 2 - deskewed.rms_mm["latched"] ** 2
    assert max(0.0, extra_mm2) ** 0.5 < deskewed.published_mm < 2.0
    assert deskewed.n > 100
