"""Strict reading of files that are no arm files."""

import pytest

from traverse.strict_toml.problems import FileError, Problem
from traverse.strict_toml.reader import StrictModel, parse_strict


class Device(StrictModel):
    id: str
    rate_hz: float = 1.0


class Settings(StrictModel):
    device: tuple[Device, ...] = ()
    broker: Device | None = None


def no_spaces(raw):
    for index, device in enumerate(raw.get("device", [])):
        if " " in str(device.get("id")):
            yield Problem(f"device[{index}].id", "has a space")


def test_strict_reading_serves_other_files():
    text = '[[device]]\nid = "a"\nrate_hz = 5\n'
    assert parse_strict(text, "d.toml", Settings, no_spaces) == Settings(
        device=(Device(id="a", rate_hz=5.0),)
    )
    text = '[[device]]\nid = "a b"\nrate = 5\n[broker]\nId = 1\n'
    with pytest.raises(FileError) as caught:
        parse_strict(text, "d.toml", Settings, no_spaces)
    assert str(caught.value).splitlines() == [
        "d.toml: 4 problems",
        "  device[0].id: has a space",
        "  device[0].rate: unknown key 'rate'; did you mean 'rate_hz'? "
        "units are part of the name",
        "  broker.Id: unknown key 'Id'; did you mean 'id'?",
        "  broker.id: is missing; add it",
    ]


def test_cross_check_alone_refuses_a_file():
    with pytest.raises(FileError, match="has a space"):
        parse_strict('[[device]]\nid = "a b"\n', "d.toml", Settings, no_spaces)
