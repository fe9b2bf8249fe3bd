"""JSON Schemas (2020-12) of the MQTT messages, from their definitions."""

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
