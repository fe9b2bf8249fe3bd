"""The tables of the reference against the code that they describe."""

import re
import tomllib
from dataclasses import fields
from importlib import import_module
from typing import Any

import pytest
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from tests.docs.pages import COMMANDS, code_words, tables, text_of
from traverse.cli.common.broker_options import BrokerOptions
from traverse.daemon.commands.rate_limit import Limit
from traverse.daemon.config import schema
from traverse.daemon.config.devices import DeviceSection
from traverse.daemon.config.filters import section_class
from traverse.daemon.config.schema import (
    BrokerSection,
    EndStopSection,
    OutboxSection,
    RecordingSection,
)
from traverse.daemon.pose import probe_library
from traverse.drivers.base.registry import DRIVERS, driver_class
from traverse.kinematics.arm_file import arm
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.kinematics.filters import FILTERS
from traverse.lab.artefacts import ARTEFACT_KINDS
from traverse.lab.artefacts.artefact import ExpandingArtefact
from traverse.lab.campaign import campaign_file
from traverse.lab.campaign.pose_table import optional_columns

SECTIONS: dict[str, list[tuple[str, type[BaseModel]]]] = {
    "docs/reference/configuration.md": [
        ("`[arm]`", schema.ArmSection),
        ("`[broker]`", BrokerSection),
        ("`[[device]]`", DeviceSection),
        *(
            (f'`driver = "{name}"`', driver_class(name).options_class)
            for name in DRIVERS
        ),
        ("`[capture]`", schema.CaptureSection),
        ("`[[capture.inputs]]`", schema.InputSection),
        ("`[uncertainty]`", schema.UncertaintySection),
        ("`[scan]`", schema.ScanSection),
        ("`[quality]`", schema.QualitySection),
        ("`[[quality.end_stops]]`", EndStopSection),
        ("`[health]`", schema.HealthSection),
        ("`[realtime]`", schema.RealtimeSection),
        ("`[metrics]`", schema.MetricsSection),
        ("`[outbox]`", OutboxSection),
        ("`[recording]`", RecordingSection),
    ],
    "docs/reference/campaign.md": [
        ("Top level", campaign_file.CampaignFile),
        ("`[circumstances]`", campaign_file.Circumstances),
        ("`[noise]`", campaign_file.Noise),
        ("`[[tools]]`", campaign_file.Tool),
        *((f"`{name}`", kind) for name, kind in ARTEFACT_KINDS.items()),
    ],
    "docs/reference/probe-library.md": [("Probe library", probe_library.LibraryProbe)],
    "docs/reference/arm-file.md": [
        ("Top level", arm.Arm),
        ("`[[joints]]`", arm.Joint),
        ("`[joints.encoder]`", arm.Encoder),
        ("`[probe]`", arm.Probe),
        ("`[reference]`", arm.Reference),
        ("`[identification]`", arm.Identification),
    ],
}
DEFAULT_COLUMN = 1


@pytest.mark.parametrize(
    ("page", "heading", "model"),
    [(page, *section) for page, sections in SECTIONS.items() for section in sections],
)
def test_every_key_stands_there_with_its_default(
    page: str, heading: str, model: type[BaseModel]
) -> None:
    by_heading = tables(page)
    of_every_kind = (
        by_heading["`[[artefacts]]`"] if model in ARTEFACT_KINDS.values() else []
    )
    if issubclass(model, ExpandingArtefact):
        of_every_kind = of_every_kind + by_heading["Expansion"]
    rows = {
        code_words(row[0])[0]: row
        for row in of_every_kind + by_heading.get(heading, [])
    }
    fields = {field.alias or name: field for name, field in model.model_fields.items()}
    assert set(rows) == set(fields)
    for name, field in fields.items():
        stated = shown_default(rows[name][DEFAULT_COLUMN])
        assert stated == default_of(field), name


def test_every_key_of_a_filter_stands_there_with_its_default() -> None:
    by_heading = tables("docs/reference/configuration.md")
    assert {code_words(row[0])[0] for row in by_heading["`[[scan.filters]]`"]} == {
        *FILTERS
    }
    stated = {
        tuple(code_words(row[0])): shown_default(row[DEFAULT_COLUMN])
        for row in by_heading["Keys of the filters"]
    }
    expected: dict[tuple[str, ...], Any] = {}
    for kind in FILTERS:
        fields = dict(section_class(kind).model_fields)
        assert fields.pop("kind").default is PydanticUndefined
        for name, field in fields.items():
            expected[kind, name] = default_of(field)
    assert stated == expected


def test_every_column_of_poses_stands_there() -> None:
    rows = tables("docs/reference/campaign.md")["Poses"]
    stated = {word for row in rows for word in code_words(row[0])}
    required = {"time_s", "artefact", "feature", "J1_rad"}
    optional = {name for names in optional_columns(["J1"]).values() for name in names}
    assert stated == required | {"tool"} | optional


def default_of(field: FieldInfo) -> Any:
    if field.default is PydanticUndefined:
        return "required"
    if field.default == () or isinstance(field.default, BaseModel):
        return None
    return field.default


def shown_default(cell: str) -> Any:
    """Parse a cell: "required", None, or a value in TOML."""
    if cell == "required":
        return cell
    if cell == "none":
        return None
    value = tomllib.loads(f"value = {code_words(cell)[0]}")["value"]
    return tuple(value) if isinstance(value, list) else value


def test_effects_are_all_there_with_class_joint_and_keys() -> None:
    rows = {
        code_words(row[0])[0]: row
        for row in tables("docs/reference/arm-file.md")["`[[effects]]`"]
    }
    assert set(rows) == set(EFFECT_KINDS)
    for name, kind in EFFECT_KINDS.items():
        _, effect_class, joint, keys, _ = rows[name]
        assert (effect_class, joint) == (kind.effect_class, kind.joint), name
        stated = [word for word in code_words(keys) if not word.startswith('"')]
        assert stated == list(kind.keys), name


def test_every_command_has_a_section() -> None:
    sections = re.findall(
        r"^## `(traverse.*)`$", text_of("docs/reference/commands.md"), re.M
    )
    assert set(sections) == set(COMMANDS)


def test_options_for_brokers_have_a_section() -> None:
    text = text_of("docs/reference/commands.md")
    (section,) = re.findall(r"^### Brokers$(.*?)^## ", text, re.M | re.DOTALL)
    stated = {word for word in code_words(section) if re.fullmatch(r"--[\w-]+", word)}
    assert stated == {
        f"--{option.name.replace('_', '-')}" for option in fields(BrokerOptions)
    }


def test_bounds_on_their_page_hold() -> None:
    heading = "Every bound, and what happens at it"
    checked = 0
    for _, bound, where, _ in tables("docs/reference/bounds.md")[heading]:
        named = re.fullmatch(r"`([a-z_.]+)\.([A-Z_]+)`", where)
        if named:
            value = getattr(import_module(named[1]), named[2])
            if isinstance(value, Limit):
                value = value.rate_hz
            stated = re.match(r"[\d. ]+", bound)
            assert stated is not None
            assert float(stated[0].replace(" ", "")) == value, where
            checked += 1
    assert checked > 8
