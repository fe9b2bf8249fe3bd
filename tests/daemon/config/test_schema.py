import pytest

from traverse.daemon.config.devices import section_class
from traverse.daemon.config.schema import read_configuration
from traverse.drivers.base.registry import DRIVERS
from traverse.drivers.latch_board.driver import LatchBoardOptions
from traverse.installation import remedy
from traverse.strict_toml.problems import FileError

GOOD = """\
[arm]
file = "arm.toml"
[broker]
host = "broker.local"
[[device]]
id = "base"
driver = "latch-board"
port = "/dev/ttyACM0"
[capture]
[[capture.inputs]]
source = "base/0"
trigger = "button"
[[capture.inputs]]
source = "base/1"
trigger = "switch"
"""


def read(tmp_path, text):
    path = tmp_path / "traverse.toml"
    path.write_text(text)
    return read_configuration(path)


def problems(tmp_path, text):
    with pytest.raises(FileError) as caught:
        read(tmp_path, text)
    return str(caught.value)


def test_what_is_left_out_has_its_documented_value(tmp_path):
    configuration = read(tmp_path, GOOD)
    assert configuration.broker.port == 1883
    assert configuration.broker.encoding == "msgpack"
    assert configuration.capture.tracking_rate_hz == 100.0
    assert configuration.health.period_s == 2.0
    button, switch = configuration.capture.inputs
    assert (button.device_id, button.number, button.trigger) == ("base", 0, "button")
    assert (switch.device_id, switch.number, switch.trigger) == ("base", 1, "switch")


def test_everything_wrong_is_reported_at_once(tmp_path):
    text = problems(
        tmp_path,
        """\
[arm]
flie = "arm.toml"
[broker]
port = 70000
encoding = "xml"
[[device]]
id = "base"
driver = "latchboard"
port = ""
[[device]]
id = "base"
driver = "latch-board"
port = "/dev/ttyACM1"
[capture]
tracking_rate_hz = "fast"
live_rate_hz = 0
[[capture.inputs]]
source = "handle/0"
trigger = "button"
[[capture.inputs]]
source = "base/9"
trigger = "lever"
[[capture.inputs]]
source = "handle/0"
trigger = "button"
[helth]
period_s = 1
""",
    )
    for where in (
        "arm.flie",
        "arm.file",
        "broker.port",
        "broker.encoding",
        "device[0].driver",
        "device[1].id",
        "capture.tracking_rate_hz",
        "capture.live_rate_hz",
        "capture.inputs[0].source",
        "capture.inputs[1].source",
        "capture.inputs[1].trigger",
        "capture.inputs[2].source",
        "helth",
    ):
        assert where in text, f"{where} is missing in:\n{text}"
    assert "names no device; there are: base" in text
    assert "is given twice" in text


def test_a_configuration_without_devices_is_refused(tmp_path):
    assert "device" in problems(tmp_path, '[arm]\nfile = "arm.toml"\n')


def test_a_device_that_is_no_table_is_refused(tmp_path):
    assert "device" in problems(tmp_path, 'device = [1]\n[arm]\nfile = "a.toml"\n')


def test_a_missing_file_is_reported_by_its_name(tmp_path):
    with pytest.raises(FileError, match=r"nowhere\.toml"):
        read_configuration(tmp_path / "nowhere.toml")


def test_an_unknown_driver_is_refused_with_the_nearest_that_exists(tmp_path):
    text = problems(tmp_path, GOOD.replace('"latch-board"', '"latchboard"'))
    assert "device[0].driver: unknown driver 'latchboard'; did you mean" in text
    assert "device[0].port" not in text  # its driver is unknown


def test_the_keys_of_a_device_are_those_of_its_driver(tmp_path):
    text = GOOD.replace(
        'port = "/dev/ttyACM0"', 'baud_rate = 5\nchanel = "can0"\ndebounce_us = 1.5'
    )
    reported = problems(tmp_path, text)
    for where in ("port", "baud_rate", "chanel", "debounce_us"):
        assert f"device[0].{where}: " in reported
    (device,) = read(tmp_path, GOOD).device
    assert device.where == "/dev/ttyACM0"
    assert device.options == LatchBoardOptions(
        port="/dev/ttyACM0", baud_rate=1_000_000, debounce_us=5000
    )


def test_a_driver_whose_library_is_missing_says_which_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(DRIVERS, "canopen", "no_such_library.canopen:CanOpenDriver")
    section_class.cache_clear()
    reported = problems(tmp_path, GOOD.replace('"latch-board"', '"canopen"'))
    section_class.cache_clear()
    assert "needs no_such_library, which is not installed" in reported
    assert remedy("can") in reported


@pytest.mark.parametrize(
    ("keys", "problem"),
    [
        ('trigger = "button"\nhold = "scan"\nlong = "undo"', "use one"),
        ('trigger = "switch"\ndouble = "undo"', "gesture of a hand"),
        ('trigger = "button"\nclick = "fly"', "click"),
    ],
)
def test_gestures_that_make_no_sense_are_refused(tmp_path, keys, problem):
    path = tmp_path / "daemon.toml"
    path.write_text(
        '[arm]\nfile = "arm.toml"\n[[device]]\nid = "base"\ndriver = "latch-board"\n'
        f'port = "/dev/null"\n[[capture.inputs]]\nsource = "base/0"\n{keys}\n'
    )
    with pytest.raises(FileError, match=problem):
        read_configuration(path)


def test_a_side_needs_a_middle(tmp_path):
    path = tmp_path / "daemon.toml"
    path.write_text(GOOD.replace("[capture]", '[capture]\ncompensation = "inside"'))
    with pytest.raises(FileError, match="needs a point in the middle"):
        read_configuration(path)
