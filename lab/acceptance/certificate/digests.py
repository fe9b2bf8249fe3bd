"""A certificate's file: schema, and digests of result, files, and over both."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from traverse.strict_toml.files import json_of
from traverse.strict_toml.problems import FileError

SCHEMA = "traverse/acceptance/1"
ALGORITHM = "SHA-256"


def digest_values(
    result: Mapping[str, Any], files: Mapping[str, str]
) -> dict[str, Any]:
    """Return the digests of files and result, and the one over both."""
    of_result = hashlib.sha256(canonical(result)).hexdigest()
    both = {"files": dict(files), "result": of_result}
    digest_of_all = hashlib.sha256(canonical(both)).hexdigest()
    return {"algorithm": ALGORITHM, **both, "digest": digest_of_all}


def canonical(values: Mapping[str, Any]) -> bytes:
    """Write values in the one way that is hashed: sorted keys, no spaces, UTF-8."""
    text = json.dumps(
        values,
        sort_keys=True,
        separators=(",", ":"),
        allow_nan=False,
        ensure_ascii=False,
    )
    return text.encode()


def read_values(file: Path) -> dict[str, Any]:
    """Read a certificate.json.

    Raises:
        FileError: It is none.
    """
    try:
        values = json_of(file)
    except (OSError, ValueError) as error:
        message = f"is not JSON: {error}"
        if isinstance(error, OSError):
            message = f"cannot be read: {error.strerror or error}; check the path"
        raise FileError(file, message) from error
    is_ours = isinstance(values, dict) and values.get("schema") == SCHEMA
    stated = values.get("digest") if is_ours else None
    if not isinstance(stated, dict) or not isinstance(stated.get("files"), dict):
        raise FileError(file, f"is no certificate: expected the schema {SCHEMA}")
    return dict(values)
