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
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from message_schemas import field_table, json_schema, json_schemas, name

from traverse.protocol import arrays, encoding
from traverse.protocol.messages import (
    COMMANDS,
    COUNTERS,
    FLAG_MEANINGS,
    LATENCIES,
    MESSAGES,
    REMARKS,
)
from traverse.protocol.topics import CHANNELS

HERE = Path(__file__).parent
REFERENCE = HERE / "reference"
GOLDEN = HERE.parent / "tests" / "protocol" / "golden"
SCHEMAS = """\
# JSON Schemas

Made from `protocol/messages` by `make schemas` (do not edit): one file for every
[message](../mqtt-messages.md) and every command, `point.schema.json` or
`command-scan.schema.json`, in JSON Schema 2020-12, for payloads in JSON.
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
    """The page, in Markdown."""
    made = Environment(
        loader=FileSystemLoader(HERE),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters |= {
        "doc": lambda value: inspect.getdoc(value) or "",
        "example": lambda key: (GOLDEN / f"{key}.json").read_text().rstrip(),
        "field_table": field_table,
        "json_schema": json_schema,
        "name": name,
        "parsed": json.loads,
        "text": json.dumps,
    }
    return made.get_template("mqtt_messages.jinja").render(
        messages=MESSAGES,
        commands=COMMANDS,
        channels=CHANNELS,
        encoding=encoding,
        flags=FLAG_MEANINGS,
        remarks=REMARKS,
        counters=COUNTERS,
        latencies=LATENCIES,
        arrays=arrays,
        golden="../../tests/protocol/golden",
    )


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
