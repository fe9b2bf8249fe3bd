"""Write the reference page, the JSON Schemas and the AsyncAPI document.

python docs/generate_messages.py            writes docs/reference/mqtt-messages.md,
                                            docs/reference/schemas/ and asyncapi.json,
                                            recording/schemas/
python docs/generate_messages.py --check    exit 1 and a diff if they differ
"""

import argparse
import difflib
import inspect
import json
import sys
from pathlib import Path

import asyncapi
from message_schemas import field_list, json_schema, json_schemas, name

from traverse.protocol import arrays
from traverse.protocol.encoding import MAX_BYTES, MAX_DEPTH, MAX_ELEMENTS
from traverse.protocol.messages import (
    COMMANDS,
    COUNTERS,
    FLAG_MEANINGS,
    LATENCIES,
    MESSAGES,
    REMARKS,
    Message,
    Point,
    Value,
)
from traverse.protocol.topics import CHANNELS

HERE = Path(__file__).parent
REFERENCE = HERE / "reference"
RECORDED = HERE.parent / "recording" / "schemas"
GOLDEN = HERE.parent / "tests" / "protocol" / "golden"
GOLDEN_FOLDER = "../../tests/protocol/golden"

HEAD = """\
# MQTT messages

Made from `protocol/messages` by `make schemas` (do not edit), like the [JSON
Schemas](schemas/README.md) and the [AsyncAPI 3 document](asyncapi.json).
"""
RULES = f"""\
- **Encoding.** A payload is one MessagePack map, or one JSON object (first byte: a
  brace) with `encoding = "json"` in the daemon's configuration. A command may use
  either. The content type of MQTT 5 is `application/msgpack` or `application/json`.
- **More examples**: [a retraction]({GOLDEN_FOLDER}/point-retraction.json), [the last
  will]({GOLDEN_FOLDER}/status-offline.json), [a
  refusal]({GOLDEN_FOLDER}/reply-error.json).
- **Left out below:** `schema` (another number at its end means another
  layout), and `arm`, which all but commands and replies have.
- **Keys** are always present; what may be left out has its default (`=null`). Units are
  in their names.
- **Types.** `name?` may be null, `number[3]` is a list of three, `name[]` a list,
  `float64[n,3]` an array, `text(64)` has at most so many characters, `0..` is a range.
- **Numbers** are finite; integers have at most 53 bits, and one is accepted where a
  number is expected. A **count** is an integer from 0.
- A **time** is nanoseconds since 1970 in UTC, which needs 61 bits: an integer in
  MessagePack (in JavaScript decode with `useBigInt64: true`), a **string** of digits
  in JSON.
- An **array** is an [extension type](#arrays) in MessagePack, nested lists in JSON.
  Without points, its free dimensions are 0.
- A **name** has 1 to 64 characters, a text at most 2000 where nothing else is stated. A
  **map** has names as keys, and any values.
- Our reader refuses more than {MAX_BYTES} bytes, {MAX_DEPTH} levels of nesting, and
  MessagePack lists or maps of more than {MAX_ELEMENTS} elements, unknown and repeated
  keys.
"""
SCHEMAS = """\
# JSON Schemas

Made from `protocol/messages` by `make schemas` (do not edit): one file for every
[message](../mqtt-messages.md) and every command, `point.schema.json` or
`command-scan.schema.json`, in JSON Schema 2020-12, for payloads in JSON.
"""
DELIVERY = "[Five rules](../how-to/read-points-in-your-program.md) hold for points.\n"
FLAGS = """\
## Quality flags

The bits of `quality` in a scan, and their names in other messages. All but remarks make
`ok` false.
"""
COMMAND_HEAD = """\
The reply is sent to the MQTT 5 response topic if the command has one, which must be
below `reply/` ([why](../security.md#answers)), else to `reply/<name>`. Choose a new
`request` for each command: a repeated one gets the first reply again and is not
carried out again. The daemon remembers 256 replies, and those to `point` and `undo`
over a restart, for ten minutes. What `args` holds depends on the name:
"""


def main() -> int:
    parser = argparse.ArgumentParser(description=inspect.getdoc(sys.modules[__name__]))
    parser.add_argument("--check", action="store_true", help="compare, do not write")
    check = parser.parse_args().check
    files = {
        REFERENCE / "schemas" / f"{key}.schema.json": json.dumps(schema, indent=2)
        for key, schema in json_schemas().items()
    }
    of_points = json.dumps(Point.model_json_schema(), indent=2)
    files[RECORDED / "point.schema.json"] = of_points
    files[REFERENCE / "schemas" / "README.md"] = SCHEMAS.rstrip()
    files[REFERENCE / "mqtt-messages.md"] = reference_page()
    files[REFERENCE / "asyncapi.json"] = asyncapi.text()
    old = set((REFERENCE / "schemas").glob("*.json")) - set(files)
    if check:
        return _compare(files, old)
    (REFERENCE / "schemas").mkdir(exist_ok=True)
    for path, text in files.items():
        path.write_text(text + "\n", encoding="utf-8")
    for path in old:
        path.unlink()
    return 0


def reference_page() -> str:
    lines = [HEAD, "| topic | payload | QoS | schema | example |", "|---" * 5 + "|"]
    lines += [*map(_message_row, MESSAGES), "", RULES]
    seen: dict[str, str] = {}
    for message in MESSAGES:
        lines += _section(f"## {message.__name__}", message, seen)
        if name(message) == "point":
            lines += ["```json", _golden("point.json"), "```", "", DELIVERY]
        if name(message) == "command":
            lines += _command_sections(seen)
    lines.append(FLAGS)
    for flag, meaning in FLAG_MEANINGS.items():
        bit, remark = flag.bit_length() - 1, "remark: " if flag & REMARKS else ""
        lines.append(f"- {bit} `{str(flag.name).lower()}`: {remark}{meaning}")
    lines += _word_list("Counters", COUNTERS) + _word_list("Latencies", LATENCIES)
    lines += ["", "## Arrays", "", inspect.getdoc(arrays) or ""]
    return "\n".join(lines)


def _message_row(message: type[Message]) -> str:
    """Topic, payload, quality of service, schema and examples of a message."""
    key = name(message)
    is_command = key == "command"
    topic = "cmd" if is_command else key
    level = "/<name>" if key in ("command", "reply") else ""
    quality = f"{CHANNELS[topic].qos}{', retained' * CHANNELS[topic].retained}"
    head = f"`traverse/<arm>/{topic}{level}` | [{message.__name__}](#{key})"
    linked = f"[`{json_schema(message)['$id']}`](schemas/{key}.schema.json)"
    example = f"{GOLDEN_FOLDER}/{'command-point' if is_command else key}"
    shown = f"[JSON]({example}.json), [MessagePack]({example}.msgpack.hex)"
    return f"| {head} | {quality} | {linked} | {shown} |"


def _section(heading: str, value: type[Value], seen: dict[str, str]) -> list[str]:
    fields = field_list(json_schema(value), heading.lstrip("# "), seen)
    return [heading, "", inspect.getdoc(value) or "", "", *fields, ""]


def _command_sections(seen: dict[str, str]) -> list[str]:
    lines = [COMMAND_HEAD]
    for command, args in COMMANDS.items():
        lines += _section(f"### cmd/{command}", args, seen)
        shown = json.loads(_golden(f"command-{command}.json"))["args"]
        link = f"[Schema](schemas/command-{command}.schema.json)"
        lines += [f"{link}; example: `{json.dumps(shown)}`", ""]
    return lines


def _golden(file: str) -> str:
    return (GOLDEN / file).read_text().rstrip()


def _word_list(title: str, words: dict[str, str]) -> list[str]:
    rows = [f"- `{word}`: {meaning}" for word, meaning in words.items()]
    return ["", f"## {title}", "", *rows]


def _compare(files: dict[Path, str], old: set[Path]) -> int:
    """Print differences of files from the definitions."""
    n_differing = len(old)
    for path in sorted(old):
        sys.stdout.write(f"{path}: no message has this schema\n")
    for path, text in files.items():
        on_disk = path.read_text(encoding="utf-8") if path.exists() else ""
        if on_disk == text + "\n":
            continue
        n_differing += 1
        sys.stdout.writelines(
            difflib.unified_diff(
                on_disk.splitlines(keepends=True),
                (text + "\n").splitlines(keepends=True),
                f"{path} (on disk)",
                f"{path} (from protocol/messages)",
            )
        )
    if n_differing:
        sys.stdout.write(f"{n_differing} files differ: run `make schemas`\n")
    return 1 if n_differing else 0


if __name__ == "__main__":
    sys.exit(main())
