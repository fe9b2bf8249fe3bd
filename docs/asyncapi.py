"""The AsyncAPI 3 document of the interface, from the same definitions as the code."""

import inspect
import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

from message_schemas import name

from traverse.protocol.messages import COMMANDS, MESSAGES, Args
from traverse.protocol.topics import CHANNELS, ROOT

Table = dict[str, Any]

GOLDEN = Path(__file__).parent.parent / "tests" / "protocol" / "golden"
ARM = {
    "arm": {
        "description": "Name of the arm, as in its arm file: one level of the topic."
    }
}
INFO = """\
Measurements of an articulated-arm coordinate measuring machine. Payloads are
MessagePack maps, or JSON objects where the daemon's configuration says so; the schemas
are of the JSON form. In MessagePack times are integers and arrays of numbers are an
extension type, see the reference of the messages.
"""


def document() -> Table:
    messages = {name(message): message for message in MESSAGES}
    channels: Table = {}
    operations: Table = {}
    components: Table = {}
    for kind, message in messages.items():
        if kind in ("command", "reply"):
            continue
        about = inspect.getdoc(message) or ""
        components[kind] = _message(kind, about, f"{kind}.schema.json")
        channels[kind] = _channel(f"{ROOT}/{{arm}}/{kind}", about, kind)
        operations[f"send_{kind}"] = _operation("send", kind, about)
    about = inspect.getdoc(messages["reply"]) or ""
    components["reply"] = _message("reply", about, "reply.schema.json")
    for command, args in COMMANDS.items():
        key = f"command_{command}"
        _add_command(channels, operations, components, key, args)
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "Traverse",
            "version": version("traverse-cmm"),
            "description": INFO,
            "license": {"name": "Apache-2.0"},
        },
        "defaultContentType": "application/msgpack",
        "servers": {
            "broker": {
                "host": "{host}:{port}",
                "protocol": "mqtt",
                "protocolVersion": "5",
                "description": "The broker of the daemon's configuration; MQTT 3.1.1 "
                "will do for all but answers on a topic of one's own.",
                "variables": {
                    "host": {"default": "localhost"},
                    "port": {"default": "1883"},
                },
            }
        },
        "channels": channels,
        "operations": operations,
        "components": {"messages": components},
    }


def text() -> str:
    """The document as JSON, which is YAML as well."""
    return json.dumps(document(), indent=2)


def _add_command(
    channels: Table, operations: Table, components: Table, key: str, args: type[Args]
) -> None:
    command, about = args.command, inspect.getdoc(args) or ""
    file = f"command-{command}"
    components[key] = _message(file, about, f"{file}.schema.json", key)
    channels[key] = _channel(f"{ROOT}/{{arm}}/cmd/{command}", about, key)
    answer = f"reply_{command}"
    purpose = f"Answers to `{command}` that name no response topic."
    channels[answer] = _channel(f"{ROOT}/{{arm}}/reply/{command}", purpose, "reply")
    operations[f"receive_{command}"] = {
        **_operation("receive", key, about, "cmd", command=key),
        "reply": {
            "channel": {"$ref": f"#/channels/{answer}"},
            "messages": [{"$ref": f"#/channels/{answer}/messages/reply"}],
        },
    }


def _message(example: str, about: str, schema: str, key: str | None = None) -> Table:
    payload = json.loads((GOLDEN / f"{example}.json").read_text("utf-8"))
    return {
        "name": key or example,
        "summary": about.partition("\n")[0],
        "payload": {"$ref": f"./schemas/{schema}"},
        "examples": [{"name": example, "payload": payload}],
    }


def _channel(address: str, about: str, message: str) -> Table:
    return {
        "address": address,
        "description": about,
        "parameters": ARM,
        "messages": {message: {"$ref": f"#/components/messages/{message}"}},
    }


def _operation(
    action: str,
    key: str,
    about: str,
    kind: str | None = None,
    command: str | None = None,
) -> Table:
    channel = CHANNELS[kind or key]
    return {
        "action": action,
        "channel": {"$ref": f"#/channels/{key}"},
        "summary": about.partition("\n")[0],
        "messages": [{"$ref": f"#/channels/{key}/messages/{command or key}"}],
        "bindings": {
            "mqtt": {
                "qos": channel.qos,
                "retain": channel.retained,
                "bindingVersion": "0.2.0",
            }
        },
    }
