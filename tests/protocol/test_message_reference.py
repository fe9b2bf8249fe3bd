import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.protocol.message_examples import EXAMPLES, GOLDEN
from tests.running import run_program

DOCS = Path(__file__).parents[2] / "docs"
RECORDED = DOCS.parent / "recording" / "schemas"
SCHEMAS = DOCS / "reference" / "schemas"


def check(docs: Path, status: int = 0) -> subprocess.CompletedProcess[str]:
    return run_program(
        sys.executable, docs / "generate_messages.py", "--check", status=status
    )


def test_reference_on_disk_is_what_the_definitions_say():
    compared = check(DOCS)
    assert (compared.stdout, compared.stderr) == ("", "")


def test_a_changed_page_and_missing_and_surplus_schemas_are_shown(tmp_path):
    docs = tmp_path / "docs"
    shutil.copytree(DOCS / "reference", docs / "reference")
    for path in DOCS.glob("*.py"):
        shutil.copy(path, docs)
    shutil.copytree(GOLDEN, tmp_path / "tests" / "protocol" / "golden")
    shutil.copytree(RECORDED, tmp_path / "recording" / "schemas")
    page = docs / "reference" / "mqtt-messages.md"
    page.write_text(page.read_text().replace("Ball centre", "Ball center", 1))
    schemas = docs / "reference" / "schemas"
    (schemas / "point.schema.json").rename(schemas / "spot.schema.json")
    shown = check(docs, status=1).stdout
    assert "-- `xyz_mm` (number[3]): Ball center" in shown
    assert "+- `xyz_mm` (number[3]): Ball centre" in shown
    assert "spot.schema.json: no message has this schema" in shown
    assert "3 files differ: run `make schemas`" in shown


@pytest.mark.parametrize("name", EXAMPLES)
def test_schema_lists_the_keys_of_the_golden_example(name):
    kind = name if name.startswith("command-") else name.split("-")[0]
    schema = json.loads((SCHEMAS / f"{kind}.schema.json").read_text())
    golden = json.loads((GOLDEN / f"{name}.json").read_text())
    assert set(schema["required"]) <= set(golden) <= set(schema["properties"])
    assert schema["additionalProperties"] is False
    assert schema["properties"]["schema"]["const"] == golden["schema"]
    if kind.startswith("command-"):
        args = schema["properties"]["args"]
        assert set(args.get("required", [])) <= set(golden["args"])
        assert set(golden["args"]) <= set(args["properties"])


def test_every_reference_inside_a_schema_leads_somewhere():
    for path in SCHEMAS.glob("*.json"):
        schema = json.loads(path.read_text())
        used = {part.split('"')[0] for part in path.read_text().split('"#/$defs/')[1:]}
        assert used <= set(schema.get("$defs", {})), path.name
