"""The rules for devices: as udev would read them.

Debian 12 has no `udevadm verify`; the effect of the rules is tested by `make test-vm`.
"""

import re

from tests.deploy.places import DEPLOY

RULES = DEPLOY / "udev/70-traverse.rules"
PART = re.compile(
    r"(?P<key>[A-Z_]+)(?:\{(?P<name>[\w/]+)\})?(?P<sign>==|!=|\+=|:=|=)"
    r'"(?P<value>[^"]*)"'
)
MATCHED = {"ACTION", "SUBSYSTEM", "SUBSYSTEMS", "KERNEL", "DRIVER", "ENV", "ATTR"}
ASSIGNED = {"GOTO", "LABEL", "SYMLINK", "ENV", "ATTR", "GROUP", "MODE", "IMPORT"}


def rules() -> list[list[re.Match[str]]]:
    """Lines as their parts; a line with anything else in it fails."""
    lines = [
        line
        for line in RULES.read_text("utf-8").splitlines()
        if line and not line.startswith("#")
    ]
    found = []
    for line in lines:
        parts = [
            PART.fullmatch(part) for part in re.split(r", (?=[A-Z_]+[{=!+:])", line)
        ]
        assert all(parts), line
        found.append([part for part in parts if part])
    return found


def test_every_part_is_a_known_match_or_assignment() -> None:
    for part in (part for rule in rules() for part in rule):
        known = MATCHED if part["sign"] in {"==", "!="} else ASSIGNED
        assert part["key"] in known, part[0]


def test_every_jump_has_its_label() -> None:
    parts = [part for rule in rules() for part in rule]
    labels = {part["value"] for part in parts if part["key"] == "LABEL"}
    assert {part["value"] for part in parts if part["key"] == "GOTO"} == labels


def test_names_are_below_one_folder_and_tell_the_serial_number() -> None:
    links = [p["value"] for rule in rules() for p in rule if p["key"] == "SYMLINK"]
    assert all(link.startswith("traverse/") for link in links)
    usb = [link for link in links if "gpio" not in link]
    assert all("$env{ID_SERIAL}" in link for link in usb)
