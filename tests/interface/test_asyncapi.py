import json
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import referencing
import referencing.jsonschema

from tests.interface.conftest import ROOT
from traverse.protocol import topics
from traverse.protocol.messages import COMMANDS

REFERENCE = ROOT / "docs" / "reference"
DOCUMENT: dict[str, Any] = json.loads((REFERENCE / "asyncapi.json").read_text("utf-8"))


def validator(file: str) -> jsonschema.Draft202012Validator:
    schema = json.loads((REFERENCE / "schemas" / file).read_text("utf-8"))
    return jsonschema.Draft202012Validator(schema)


def resolved(reference: str) -> Any:
    value: Any = DOCUMENT
    for step in reference.removeprefix("#/").split("/"):
        value = value[step]
    return value


def references(value: Any) -> list[str]:
    if isinstance(value, dict):
        references_here = [value["$ref"]] if isinstance(value.get("$ref"), str) else []
        return references_here + [
            r for inner in value.values() for r in references(inner)
        ]
    if isinstance(value, list):
        return [r for inner in value for r in references(inner)]
    return []


def test_the_document_is_one_by_the_specification_of_asyncapi(
    node_modules: Path,
) -> None:
    path = node_modules / "@asyncapi" / "specs" / "schemas" / "3.0.0.json"
    schema = json.loads(path.read_text("utf-8"))
    resources = [
        (key, referencing.jsonschema.DRAFT7.create_resource(inner))
        for key, inner in schema["definitions"].items()
    ]
    registry: Any = referencing.Registry().with_resources(resources)
    jsonschema.Draft7Validator(schema, registry=registry).validate(DOCUMENT)
    broken = {**DOCUMENT, "operations": {"x": {"action": "shout"}}}
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.Draft7Validator(schema, registry=registry).validate(broken)


def test_every_reference_leads_somewhere() -> None:
    leads = references(DOCUMENT)
    assert len(leads) > 50
    for reference in leads:
        if reference.startswith("#/"):
            assert resolved(reference)
        else:
            assert (REFERENCE / reference).is_file(), reference


def test_every_topic_and_command_is_there_and_no_other() -> None:
    addresses = {channel["address"] for channel in DOCUMENT["channels"].values()}
    expected = {
        f"traverse/{{arm}}/{kind}"
        for kind in topics.CHANNELS
        if kind not in topics.NAMED
    }
    for kind in topics.NAMED:
        expected |= {f"traverse/{{arm}}/{kind}/{command}" for command in COMMANDS}
    assert addresses == expected


def test_its_examples_are_good_by_its_schemas() -> None:
    n = 0
    for message in DOCUMENT["components"]["messages"].values():
        accept = validator(Path(message["payload"]["$ref"]).name)
        for example in message["examples"]:
            accept.validate(example["payload"])
            with pytest.raises(jsonschema.ValidationError):
                accept.validate({**example["payload"], "schema": "traverse/other/1"})
            n += 1
    assert n == len(DOCUMENT["components"]["messages"])


def test_the_page_shows_the_reader_that_is_tested() -> None:
    page = (ROOT / "docs" / "how-to" / "read-points-in-your-program.md").read_text()
    _, *lines = (
        (ROOT / "docs" / "integrations" / "points.mjs")
        .read_text("utf-8")
        .splitlines(keepends=True)
    )
    assert f"```js\n{''.join(lines)}```" in page
