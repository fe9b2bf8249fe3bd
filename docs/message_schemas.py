"""JSON Schemas (2020-12) of the MQTT messages, and tables of their fields."""

import json
from collections.abc import Iterator
from typing import Any

from traverse.protocol.messages import COMMANDS, MESSAGES, Args, Command, Value

DIALECT = "https://json-schema.org/draft/2020-12/schema"

Schema = dict[str, Any]


def json_schemas() -> dict[str, Schema]:
    """Every schema by the name of its file: each message, each command."""
    schemas = {name(message): json_schema(message) for message in MESSAGES}
    for command, args in COMMANDS.items():
        schemas[f"command-{command}"] = command_schema(args)
    return schemas


def name(message: type[Value]) -> str:
    """The name of a message in files and topics: "point"."""
    return message.__name__.lower()


def json_schema(value: type[Value]) -> Schema:
    """The schema of a message's JSON payload."""
    schema = value.model_json_schema()
    if "schema" in schema.get("properties", {}):
        # It has a default for whoever builds a message; no payload is without it.
        schema["required"] = ["schema", *schema.get("required", [])]
        schema["$id"] = schema["properties"]["schema"]["const"]
        schema = {"$schema": DIALECT} | schema
    return schema


def command_schema(args: type[Args]) -> Schema:
    """The envelope with the arguments of one command in it."""
    schema = json_schema(Command)
    inner = args.model_json_schema()
    definitions = schema.pop("$defs", {}) | inner.pop("$defs", {})
    schema["properties"]["args"] = inner
    schema["title"] = args.__name__.removesuffix("Args") + "Command"
    schema["description"] = inner["description"]
    schema["$id"] += f"/{args.command}"
    return schema | ({"$defs": definitions} if definitions else {})


USUAL_LENGTH = 2000
"""Most characters of a text; stated where it is another."""


def field_table(schema: Schema, heading: str, seen: dict[str, str]) -> list[str]:
    """A Markdown table of the fields of an object; not of its schema and arm.

    Fields of an inner structure follow it: `outer.field`, `list[].field`. Fields that
    an earlier table has, equal in all, are only named.

    Args:
        schema: of the object.
        heading: that of this table.
        seen: headings of the first tables by field, which this adds to.
    """
    rows: list[str] = []
    again: dict[str, list[str]] = {}
    for key, field in schema.get("properties", {}).items():
        first = seen.setdefault(json.dumps([key, field]), heading)
        if key in ("schema", "arm"):
            continue
        if first == heading:
            rows += _field_rows(key, field, schema.get("$defs", {}))
        else:
            link = f"[{first}](#{first.lower().replace('/', '')})"
            again.setdefault(link, []).append(f"`{key}`")
    places = "; in ".join(f"{link}: {', '.join(keys)}" for link, keys in again.items())
    lines = [f"As in {places}.", ""] if places else []
    head = ["| field | type | meaning |", "|---|---|---|"]
    return [*lines, *head, *rows] if rows else lines or ["No fields."]


def _field_rows(path: str, field: Schema, inner: Schema) -> Iterator[str]:
    meaning = " ".join(str(field.get("description", "")).split())
    kind = type_text(field)
    if "default" in field:
        kind += f", default {json.dumps(field['default'])}"
    yield f"| `{path}` | {kind} | {meaning} |"
    for one in field.get("anyOf", [field]):
        named = one.get("patternProperties", {}).values()
        parts = [("", one), ("[]", one.get("items", {}))]
        for mark, part in [*parts, *((".<name>", each) for each in named)]:
            if "$ref" in part:
                target = inner[part["$ref"].rsplit("/", 1)[-1]]
                for key, each in target["properties"].items():
                    yield from _field_rows(f"{path}{mark}.{key}", each, inner)


def type_text(schema: Schema) -> str:
    """A type in words that fit both encodings."""
    if "anyOf" in schema:
        return " or ".join(type_text(one) for one in schema["anyOf"])
    if "$ref" in schema:
        return "map"
    if "const" in schema:
        return f'`"{schema["const"]}"`'
    if "enum" in schema:
        return ", ".join(f'`"{value}"`' for value in schema["enum"])
    return _structure_text(schema)


def _structure_text(schema: Schema) -> str:
    """What is made of elements, and what is a single value."""
    if "x-dtype" in schema:
        shape = ", ".join(map(str, schema["x-shape"]))
        return f"array {schema['x-dtype']} ({shape})"
    kind = schema.get("type")
    if kind == "array":
        return _list_text(schema)
    if kind == "object":
        values = schema.get("additionalProperties")
        return f"map of names to {type_text(values)}" if values else "map"
    if schema.get("format") == "time-ns":
        return "time"
    if schema.get("minLength") == 1 and schema["maxLength"] == 64:
        return "name"
    return f"{_KINDS[str(kind)]}{_limits(schema)}".replace("integer from 0", "count")


_KINDS = {
    "string": "text",
    "number": "number",
    "integer": "integer",
    "boolean": "bool",
    "null": "null",
}


def _list_text(schema: Schema) -> str:
    if "prefixItems" in schema:
        items = schema["prefixItems"]
        return f"[{len(items)}] {type_text(items[0])}"
    return f"list of {type_text(schema['items'])}"


def _limits(schema: Schema) -> str:
    """Only limits that say something: not those of 53 bits."""
    if schema.get("maximum", 0) >= 2**53 - 1:
        return " from 0" if schema.get("minimum") == 0 else ""
    texts = []
    if "exclusiveMinimum" in schema:
        texts.append(f"above {schema['exclusiveMinimum']:g}")
    if "minimum" in schema:
        texts.append(f"from {schema['minimum']}")
    if "maximum" in schema:
        texts.append(f"to {schema['maximum']}")
    if schema.get("maxLength", USUAL_LENGTH) != USUAL_LENGTH:
        texts.append(f"up to {schema['maxLength']} characters")
    return " " + " ".join(texts) if texts else ""
