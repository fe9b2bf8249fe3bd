import pytest

from traverse.cli.setup.draft import KEPT, Draft
from traverse.cli.setup.ports import can_interfaces, serial_ports
from traverse.cli.setup.settings import settings_of
from traverse.daemon.config.devices import section_class
from traverse.daemon.config.schema import CaptureSection, InputSection
from traverse.drivers.base.registry import DRIVERS
from traverse.strict_toml.problems import FileError

TEXT = """# bench 7
[arm]
file = "arm.toml"  # identified in May

[[device]]
id = "base"
driver = "latch-board"
port = "/dev/ttyACM0"  # the left one

[capture]
hold_s = 0.5
inputs = [{ source = "base/0", trigger = "button" }]
"""
BUTTON = {"source": "base/1", "trigger": "button"}


@pytest.fixture
def draft(tmp_path):
    (tmp_path / "traverse.toml").write_text(TEXT)
    return Draft(tmp_path / "traverse.toml")


def test_a_change_keeps_comments_and_what_is_not_changed(draft):
    draft.set_table("capture", {"live_rate_hz": 10.0, "hold_s": None})
    draft.set_devices([*draft.devices, {"id": "wrist", "driver": "rls", "bits": None}])
    draft.set_table("metrics", {"port": 9000, "host": None})
    assert draft.values == {
        "arm": {"file": "arm.toml"},
        "device": [
            {"id": "base", "driver": "latch-board", "port": "/dev/ttyACM0"},
            {"id": "wrist", "driver": "rls"},
        ],
        "capture": {
            "live_rate_hz": 10.0,
            "inputs": [{"source": "base/0", "trigger": "button"}],
        },
        "metrics": {"port": 9000},
    }
    for comment in ("# bench 7", "# identified in May", "# the left one"):
        assert comment in draft.text


def test_a_table_that_becomes_empty_goes(draft):
    draft.set_table("capture", {"hold_s": None, "inputs": None})
    draft.set_devices([])
    assert draft.values == {"arm": {"file": "arm.toml"}}


def test_mistakes_are_named_in_the_file_itself(draft):
    draft.set_table("capture", {"hold_s": "long"})
    (problem,) = draft.problems()
    assert str(draft.path) in problem
    assert "capture.hold_s" in problem
    assert [path.name for path in draft.path.parent.iterdir()] == ["traverse.toml"]
    draft.set_table("capture", {"hold_s": 1.0})
    (problem,) = draft.problems()
    assert "arm.toml" in problem


def test_no_toml_is_refused_and_the_text_stays(draft):
    with pytest.raises(FileError):
        draft.replace_text("[arm")
    assert draft.text == TEXT


def test_the_file_before_is_kept_beside_and_only_the_newest_ones(draft):
    assert draft.write() is None  # nothing has changed
    for number in range(KEPT + 3):
        draft.set_table("metrics", {"port": 9000 + number})
        previous = draft.write()
    copies = sorted(draft.path.parent.glob("*.old"))
    assert len(copies) == KEPT
    assert previous == copies[-1]
    assert f"port = {9000 + KEPT + 1}" in previous.read_text()
    assert f"port = {9000 + KEPT + 2}" in draft.path.read_text()


@pytest.mark.parametrize("driver", DRIVERS)
def test_what_a_form_writes_is_what_the_driver_reads(driver):
    """Each setting's text gives its value again, of the right type."""
    model = section_class(driver)
    for setting in settings_of(model):
        default = model.model_fields[setting.key].get_default()
        if not setting.is_required and default not in (None, "", ()):
            assert setting.value_of(setting.text_of(default)) == default


@pytest.mark.parametrize(
    ("model", "key", "text", "value"),
    [
        (CaptureSection, "hold_s", "0.25", 0.25),
        (CaptureSection, "hold_s", " ", None),
        (CaptureSection, "hold_s", "long", "long"),
        (CaptureSection, "max_waiting_points", "20", 20),
        (InputSection, "click", "undo", "undo"),
        (section_class("rls"), "ports", "/dev/a, /dev/b", ["/dev/a", "/dev/b"]),
        (section_class("amt21"), "addresses", "[84, 88]", [84, 88]),
        (section_class("rls"), "turns", "yes", True),
    ],
)
def test_values_of_texts(model, key, text, value):
    (setting,) = (setting for setting in settings_of(model) if setting.key == key)
    assert setting.value_of(text) == value


def test_ports_with_a_name_that_stays_come_first_and_once(tmp_path):
    for name in ("ttyUSB0", "ttyACM0", "tty0", "null"):
        (tmp_path / name).touch()
    named = tmp_path / "serial" / "by-id"
    named.mkdir(parents=True)
    (named / "usb-board").symlink_to(tmp_path / "ttyACM0")
    assert serial_ports(tmp_path) == [named / "usb-board", tmp_path / "ttyUSB0"]


def test_can_interfaces_are_told_by_their_type(tmp_path):
    for name, kind in (("can0", "280"), ("eth0", "1"), ("vcan1", "280")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "type").write_text(f"{kind}\n")
    (tmp_path / "bonding_masters").write_text("")
    assert can_interfaces(tmp_path) == ["can0", "vcan1"]
