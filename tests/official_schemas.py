"""Official schemas of QIF and DCC, not ours to keep: where their folder is named."""

import os
from pathlib import Path

import pytest

from traverse.cli.common.qif_check import SCHEMA
from traverse.lab.certificates.xml import SCHEMA as DCC_SCHEMA

SCHEMAS = Path(os.environ.get("TRAVERSE_SCHEMAS", "/nonexistent"))
needs_schemas = pytest.mark.skipif(
    not (SCHEMAS / SCHEMA).is_file(), reason=f"TRAVERSE_SCHEMAS has no {SCHEMA}"
)
needs_dcc_schema = pytest.mark.skipif(
    not (SCHEMAS / DCC_SCHEMA).is_file(), reason=f"TRAVERSE_SCHEMAS has no {DCC_SCHEMA}"
)
