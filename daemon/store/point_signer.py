"""Signatures of points, in a chain for each session."""

import stat
from base64 import b64encode
from pathlib import Path
from typing import TYPE_CHECKING

from traverse.installation import missing
from traverse.protocol.messages import Point
from traverse.protocol.signed_points import content_of, first_link, link_to
from traverse.strict_toml.files import bytes_of

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey


class PointSigner:
    """Signs points in order.

    Attributes:
        public_key: base 64.
    """

    def __init__(self, key: "Ed25519PrivateKey") -> None:
        self._key = key
        self.public_key = b64encode(key.public_key().public_bytes_raw()).decode()
        self._session, self._link = "", ""

    def signed(self, point: Point) -> Point:
        if point.session != self._session:
            self._session, self._link = point.session, first_link(point.session)
        update: dict[str, str | None] = {"previous": self._link, "signature": None}
        content = content_of(point.model_copy(update=update))
        update["signature"] = b64encode(self._key.sign(content)).decode()
        signed = point.model_copy(update=update)
        self._link = link_to(content)
        return signed

    def roll_back(self, point: Point) -> None:
        """Forget the newest signed point, which was not stored."""
        self._session, self._link = point.session, point.previous or ""


def read_signer(path: Path) -> PointSigner:
    """Read the key of the arm, PEM.

    Raises:
        ValueError: it cannot be used; says why, and what to do.
        OSError: the file cannot be read.
    """
    try:
        from cryptography.hazmat.primitives.asymmetric.ed25519 import (  # noqa: PLC0415 - an extra
            Ed25519PrivateKey,
        )
        from cryptography.hazmat.primitives.serialization import (  # noqa: PLC0415
            load_pem_private_key,
        )
    except ModuleNotFoundError as error:
        raise ValueError(missing("signing", "cryptography", "signed")) from error
    content = bytes_of(path)
    mode = stat.S_IMODE(path.stat().st_mode)
    if mode & 0o077:
        raise ValueError(
            f"can be read by others than its owner (mode {mode:04o}): anybody could "
            "sign; chmod 600 it, or make a new one"
        )
    try:
        key = load_pem_private_key(content, None)
    except (ValueError, TypeError) as error:
        raise ValueError(
            f"is no private key without a password, in PEM form ({error}); make one "
            "with `traverse points key`"
        ) from error
    if not isinstance(key, Ed25519PrivateKey):
        raise ValueError(
            f"is a key of another kind ({type(key).__name__}), expected Ed25519; make "
            "one with `traverse points key`"
        )
    return PointSigner(key)
