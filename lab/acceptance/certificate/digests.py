"""Digests of a certificate: of its result, its files, and over both."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

SCHEMA = "traverse/acceptance/1"
ALGORITHM = "SHA-256"


def digest_values(
    result: Mapping[str, Any], files: Mapping[str, str]
) -> dict[str, Any]:
    """Return the digests of files and result, and the one over both."""
    of_result = hashlib.sha256(canonical(result)).hexdigest()
    both = {"files": dict(files), "result": of_result}
    whole = hashlib.sha256(canonical(both)).hexdigest()
    return {"algorithm": ALGORITHM, **both, "digest": whole}


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
