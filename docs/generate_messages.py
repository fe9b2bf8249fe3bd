"""Write the reference page, the JSON Schemas and the AsyncAPI document.

python docs/generate_messages.py            writes docs/reference/mqtt-messages.md,
                                            docs/reference/schemas/ and asyncapi.json
python docs/generate_messages.py --check    exit 1 and a diff if they differ
"""

import argparse
import difflib
import inspect
import json
import sys
from pathlib import Path

import asyncapi
from message_schemas import json_schema, json_schemas, name
from message_tables import Schema, field_table

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
)
from traverse.protocol.topics import CHANNELS

HERE = Path(__file__).parent
REFERENCE = HERE / "reference"
GOLDEN = HERE.parent / "tests" / "protocol" / "golden"
EXTRA_EXAMPLES = {
    "status": "status-offline",
    "point": "point-retraction",
    "reply": "reply-error",
}
HEX_LIMIT = 1000

HEAD = f"""\
# MQTT messages

Generated from `protocol/messages` by `make schemas`; do not edit.

All topics are `traverse/<arm>/<kind>`. A payload is one MessagePack map, or one JSON
object where the configuration says so; the first byte tells which (a JSON object begins
with a brace). MQTT 5 payloads have the content type `application/msgpack` or
`application/json`, which nobody needs in order to read them.

- Every payload has `schema`. Another number at its end means another layout. Keys that
  are not listed here, and keys given twice, are refused by our own reader.
- All keys are always there, null where it says so, unless "may be left out" stands
  beside.
- A number is finite: NaN and infinity are refused. An integer is good where a number is
  expected, not the reverse. Integers have at most 53 bits.
- A *time* is nanoseconds since 1970 in UTC: an integer in MessagePack, a **string** of
  digits in JSON, since it needs 61 bits.
- An *array* is an [extension type](#arrays) in MessagePack, nested lists in JSON.
  Without points, its free dimensions are 0.
- A *name* has 1 to 64 characters. Units are in the names of the fields.
- Our reader refuses more than {MAX_BYTES} bytes, {MAX_DEPTH} levels of nesting, and
  MessagePack lists or maps of more than {MAX_ELEMENTS} elements.

JSON Schemas of all payloads in JSON are [files](schemas/README.md).
"""
SCHEMAS = """\
Generated from `protocol/messages` by `make schemas`; do not edit. One file for every
[message](../mqtt-messages.md) and every command, in JSON Schema 2020-12, for payloads
in JSON.
"""
DELIVERY = """\
`seq` is without gaps per `session`. A point is delivered at least once and counts once
per `id`. A consumer that sees a gap in (session, seq), or starts late,
asks `cmd/resend`.
"""
COMMAND_HEAD = """\
A command is answered on the MQTT 5 response topic if it has one, which has to be below
`reply/` ([why](../security.md#answers)), else on `reply/<name>`; a repeated `request`
gets the first answer again. What `args` holds depends on the name:
"""


def main() -> int:
    """Write, or compare, all files."""
    parser = argparse.ArgumentParser(description=inspect.getdoc(sys.modules[__name__]))
    parser.add_argument("--check", action="store_true", help="compare, do not write")
    check = parser.parse_args().check
    files = {
        REFERENCE / "schemas" / f"{key}.schema.json": json.dumps(schema, indent=2)
        for key, schema in json_schemas().items()
    }
    files[REFERENCE / "schemas" / "README.md"] = schemas_page()
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


def schemas_page() -> str:
    """What the folder of schemas holds, in Markdown."""
    lines = ["# JSON Schemas", "", SCHEMAS, "| file | payload |", "|---|---|"]
    for key, schema in json_schemas().items():
        file, what = f"{key}.schema.json", schema["description"].splitlines()[0]
        lines.append(f"| [{file}]({file}) | {what} |")
    return "\n".join(lines)


def reference_page() -> str:
    """The page, in Markdown."""
    lines = [HEAD]
    for message in MESSAGES:
        lines += _message_section(message)
        if name(message) == "point":
            lines += [DELIVERY]
        if name(message) == "command":
            lines += _command_sections()
    lines += [
        "## Quality flags",
        "",
        "| bit | name | ok | meaning |",
        "|---|---|---|---|",
    ]
    for flag, meaning in FLAG_MEANINGS.items():
        verdict = "stays" if flag & REMARKS else "false"
        bit, word = flag.bit_length() - 1, str(flag.name).lower()
        lines.append(f"| {bit} | `{word}` | {verdict} | {meaning} |")
    lines += _word_table("Counters", COUNTERS) + _word_table("Latencies", LATENCIES)
    lines += ["", "## Arrays", "", inspect.getdoc(arrays) or ""]
    return "\n".join(lines)


def _message_section(message: type[Message]) -> list[str]:
    schema, key = json_schema(message), name(message)
    topic = {"command": "cmd"}.get(key, key)
    channel = CHANNELS[topic]
    level = "/<name>" if key in ("command", "reply") else ""
    retained = ", retained" if channel.retained else ""
    lines = [f"## {message.__name__}", "", inspect.getdoc(message) or "", ""]
    lines += [
        f"Topic `traverse/<arm>/{topic}{level}`, QoS {channel.qos}{retained}.",
        "",
    ]
    lines += [*field_table(schema), "", *_inner_tables(schema)]
    if key == "command":
        return lines
    lines += _example(key)
    return lines + (_example(EXTRA_EXAMPLES[key]) if key in EXTRA_EXAMPLES else [])


def _inner_tables(schema: Schema) -> list[str]:
    lines: list[str] = []
    for key, inner in schema.get("$defs", {}).items():
        # Quality stands with the point; the live message has the same.
        if key == "Quality" and schema["title"] != "Point":
            continue
        lines += [f"### {key}", "", inner["description"], "", *field_table(inner), ""]
    return lines


def _command_sections() -> list[str]:
    lines = [COMMAND_HEAD]
    for command, args in COMMANDS.items():
        lines += [f"### cmd/{command}", "", inspect.getdoc(args) or "", ""]
        lines += [*field_table(json_schema(args)), "", *_example(f"command-{command}")]
    return lines


def _example(key: str) -> list[str]:
    """A golden example; of long ones the bytes are in the file only."""
    lines = ["```json", (GOLDEN / f"{key}.json").read_text().rstrip(), "```", ""]
    packed = (GOLDEN / f"{key}.msgpack.hex").read_text().rstrip()
    if len(packed) > HEX_LIMIT:
        link = f"../../tests/protocol/golden/{key}.msgpack.hex"
        return [*lines, f"The same in MessagePack: [{key}.msgpack.hex]({link}).", ""]
    return [*lines, "The same in MessagePack:", "", "```", packed, "```", ""]


def _word_table(title: str, words: dict[str, str]) -> list[str]:
    rows = [f"| `{word}` | {meaning} |" for word, meaning in words.items()]
    return ["", f"## {title}", "", "| name | meaning |", "|---|---|", *rows]


def _compare(files: dict[Path, str], old: set[Path]) -> int:
    """Print what differs on disk from what the definitions say."""
    n_differing = len(old)
    for path in sorted(old):
        sys.stdout.write(f"{path}: no message has this schema\n")
    for path, text in files.items():
        found = path.read_text(encoding="utf-8") if path.exists() else ""
        if found == text + "\n":
            continue
        n_differing += 1
        sys.stdout.writelines(
            difflib.unified_diff(
                found.splitlines(keepends=True),
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
