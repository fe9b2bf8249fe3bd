"""The official schema of QIF, which is not ours to keep: where its folder is named."""

import os
from pathlib import Path

import pytest

from traverse.cli.common.qif_check import SCHEMA

SCHEMAS = Path(os.environ.get("TRAVERSE_SCHEMAS", "/nonexistent"))
needs_schemas = pytest.mark.skipif(
    not (SCHEMAS / SCHEMA).is_file(), reason=f"TRAVERSE_SCHEMAS has no {SCHEMA}"
)
