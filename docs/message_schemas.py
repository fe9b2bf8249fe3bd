"""JSON Schemas (2020-12) of the MQTT messages, and lists of their fields."""

import json
import textwrap
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
    return message.__name__.lower()


def json_schema(value: type[Value]) -> Schema:
    schema = value.model_json_schema()
    if "schema" in schema.get("properties", {}):
        # It has a default for whoever builds a message; no payload is without it.
        schema["required"] = ["schema", *schema.get("required", [])]
        schema["$id"] = schema["properties"]["schema"]["const"]
        schema = {"$schema": DIALECT} | schema
    return schema


def command_schema(args: type[Args]) -> Schema:
    schema = json_schema(Command)
    inner = args.model_json_schema()
    definitions = schema.pop("$defs", {}) | inner.pop("$defs", {})
    schema["properties"]["args"] = inner
    schema["title"] = args.__name__.removesuffix("Args") + "Command"
    schema["description"] = inner["description"]
    schema["$id"] += f"/{args.command}"
    return schema | ({"$defs": definitions} if definitions else {})


WIDTH = 120
USUAL_LENGTH = 2000
"""Most characters of a text; stated where it is another."""


def field_list(schema: Schema, heading: str, seen: dict[str, str]) -> list[str]:
    """The fields of an object as a list in Markdown; not its schema and arm.

    Fields of an inner structure follow it: `outer.field`, `list[].field`. Fields that
    an earlier list has, equal in all, are only named.

    Args:
        schema: of the object.
        heading: that of this list.
        seen: headings of the first lists by field, which this adds to.
    """
    rows: list[str] = []
    keys_of: dict[str, list[str]] = {}
    for key, field in schema.get("properties", {}).items():
        first = seen.setdefault(json.dumps([key, field]), heading)
        if key in ("schema", "arm"):
            continue
        if first == heading:
            rows += _field_rows(key, field, schema.get("$defs", {}))
        else:
            link = f"[{first}](#{first.lower().replace('/', '')})"
            keys_of.setdefault(link, []).append(f"`{key}`")
    places = "; in ".join(
        f"{link}: {', '.join(keys)}" for link, keys in keys_of.items()
    )
    lines = [f"As in {places}.", ""] if places else []
    return [*lines, *rows] or ["No fields."]


def _field_rows(path: str, field: Schema, inner: Schema) -> Iterator[str]:
    meaning = " ".join(str(field.get("description", "")).split()).replace(" [UTC]", "")
    kind = type_text(field)
    if "default" in field:
        kind += f" ={json.dumps(field['default'])}"
    text = f"- `{path}` ({kind}): {meaning}"
    yield textwrap.fill(text, WIDTH, subsequent_indent="  ", break_on_hyphens=False)
    for branch in field.get("anyOf", [field]):
        named = branch.get("patternProperties", {}).values()
        parts = [("", branch), ("[]", branch.get("items", {}))]
        for mark, part in [*parts, *((".<name>", each) for each in named)]:
            if "$ref" in part:
                target = inner[part["$ref"].rsplit("/", 1)[-1]]
                for key, each in target["properties"].items():
                    yield from _field_rows(f"{path}{mark}.{key}", each, inner)


def type_text(schema: Schema) -> str:
    """A type in a word that fits both encodings."""
    if "anyOf" in schema:
        kind, _, limits = type_text(schema["anyOf"][0]).partition(" ")
        return f"{kind}? {limits}".rstrip()
    if "const" in schema or "enum" in schema:
        values = schema.get("enum", [schema.get("const")])
        return ", ".join(f'`"{value}"`' for value in values)
    if "x-dtype" in schema:
        return f"{schema['x-dtype']}[{','.join(map(str, schema['x-shape']))}]"
    kind = schema.get("type", "object")
    if kind == "array":
        items = schema.get("prefixItems", [])
        return f"{type_text([*items, schema.get('items')][0])}[{len(items) or ''}]"
    if kind == "object":
        values = schema.get("additionalProperties")
        return f"map of {type_text(values)}" if values else "map"
    return _scalar_text(schema, kind)


def _scalar_text(schema: Schema, kind: str) -> str:
    """A single value, with limits that say something: not those of 53 bits."""
    if schema.get("format") == "time-ns":
        return "time"
    if kind == "string":
        longest = schema.get("maxLength", USUAL_LENGTH)
        if schema.get("minLength") == 1 and longest == 64:
            return "name"
        return "text" if longest == USUAL_LENGTH else f"text({longest})"
    largest = schema.get("maximum", "")
    if largest and largest >= 2**53 - 1:
        return "count" if schema["minimum"] == 0 else kind
    above = schema.get("exclusiveMinimum")
    least = schema.get("minimum", "") if above is None else f">{above:g}"
    limits = f" {least}..{largest}" if f"{least}{largest}" else ""
    return f"{kind.removesuffix('ean')}{limits}"
