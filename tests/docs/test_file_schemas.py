import json
import sys
import tomllib
from datetime import date
from functools import cache
from typing import Any

import jsonschema
import pytest

from tests.docs.pages import CHECKOUT, examples
from tests.running import run_program

FOLDER = CHECKOUT / "docs" / "reference" / "file-schemas"
KINDS = {
    "arm": "arm",
    "daemon": "configuration",
    "simulator": "simulator",
    "campaign": "campaign",
}
EXAMPLES = [
    (kind, page, text) for kind in KINDS for page, text in examples(kind) if text
]


@cache
def validator(name: str) -> Any:
    schema = json.loads((FOLDER / f"{name}.schema.json").read_text("utf-8"))
    jsonschema.Draft7Validator.check_schema(schema)
    return jsonschema.Draft7Validator(schema)


def plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [plain(entry) for entry in value]
    return value.isoformat() if isinstance(value, date) else value


def mistakes(name: str, values: dict[str, Any]) -> list[str]:
    return [error.message for error in validator(name).iter_errors(plain(values))]


def test_the_schemas_are_those_of_the_models() -> None:
    run_program(sys.executable, CHECKOUT / "docs" / "file_schemas.py", "--check")


@pytest.mark.parametrize(("kind", "page", "text"), EXAMPLES)
def test_examples_of_the_pages_are_valid(kind: str, page: str, text: str) -> None:
    assert mistakes(KINDS[kind], tomllib.loads(text)) == [], page


def changed(values: dict[str, Any], path: list[Any], value: Any) -> dict[str, Any]:
    copy: dict[str, Any] = json.loads(json.dumps(plain(values)))
    inner: Any = copy
    for step in path[:-1]:
        inner = inner[step]
    inner[path[-1]] = value
    return copy


@pytest.mark.parametrize(
    ("kind", "path", "value"),
    [
        ("arm", ["joints", 0, "zero_deg"], 90.0),
        ("arm", ["joints", 0, "axis"], [0, 0, 0, 1]),
        ("arm", ["probe", "kind"], "soft"),
        ("arm", ["effects"], [{"kind": "no_such_effect"}]),
        ("arm", ["schema"], "traverse/arm/2"),
        ("daemon", ["device", 0, "driver"], "no-such-driver"),
        ("daemon", ["device", 0, "bauds"], 9600),
        ("daemon", ["arm", "file"], 3),
        ("campaign", ["artefacts", 0, "kind"], "kone"),
        ("campaign", ["artefacts", 0, "colour"], "red"),
        ("simulator", ["motion"], [{"kind": "dance"}]),
        ("simulator", ["sead"], 1),
    ],
)
def test_what_a_reader_refuses_is_marked(
    kind: str, path: list[Any], value: Any
) -> None:
    _, text = examples(kind)[0]
    values = tomllib.loads(text)
    assert mistakes(KINDS[kind], values) == []
    assert mistakes(KINDS[kind], changed(values, path, value)), (path, value)
