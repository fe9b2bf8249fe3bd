import hashlib
import json
from base64 import b64encode
from dataclasses import dataclass

import msgpack
import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import (
    Ed25519PrivateKey,
    Ed25519PublicKey,
)
from hypothesis import given
from hypothesis import strategies as st

from tests.protocol.message_examples import POINT
from traverse.daemon.store.point_signer import PointSigner, read_signer
from traverse.protocol.encoding import decode, encode
from traverse.protocol.messages import Point
from traverse.protocol.signed_points import (
    checked_points,
    points_of_lines,
    read_public_key,
)

KEY = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
PUBLIC = KEY.public_key().public_bytes_raw()


def point(seq: int, session: str = "s", **changes: object) -> Point:
    fields = {
        "session": session,
        "seq": seq,
        "id": f"{session}-{seq}",
        "retracts": None,
    }
    return POINT.model_copy(update={**fields, **changes})


def signed(
    n: int, session: str = "s", signer: PointSigner | None = None
) -> list[Point]:
    signer = signer or PointSigner(KEY)
    return [signer.signed(point(seq, session)) for seq in range(n)]


CHAIN = tuple(signed(12))
OTHER = tuple(signed(12, signer=PointSigner(Ed25519PrivateKey.generate())))


def problems(points: list[Point]) -> list[str]:
    return checked_points(points, PUBLIC).problems


@pytest.mark.parametrize("encoding", ["json", "msgpack"])
def test_a_whole_chain_whatever_way_it_went(encoding) -> None:
    two = [*CHAIN, *signed(3, "t")]
    arrived = [decode(Point, encode(point, encoding)) for point in two]
    assert problems(arrived) == []
    assert problems([arrived[0], *arrived]) == []  # twice is at least once
    assert problems([*arrived[:5], *arrived[2:]]) == []
    assert checked_points(arrived, PUBLIC).last == {"s": 11, "t": 2}


def test_bytes_that_are_signed_are_those_of_the_documentation() -> None:
    """Without the product's code: another program needs the page alone."""
    before = hashlib.sha256(b"s").hexdigest()
    key = Ed25519PublicKey.from_public_bytes(PUBLIC)
    for point in CHAIN:
        fields = json.loads(encode(point, "json"))
        values = msgpack.unpackb(encode(point, "msgpack"))
        assert list(values) == list(fields)
        signature = values["signature"]
        assert values["previous"] == before
        values["signature"] = None
        content = msgpack.packb(values)
        before = hashlib.sha256(content).hexdigest()
        padded = signature.encode()
        import base64  # noqa: PLC0415

        key.verify(base64.b64decode(padded), content)


@dataclass
class Change:
    name: str
    place: int
    to: int


CHANGES = st.builds(
    Change,
    st.sampled_from(["remove", "alter", "insert", "move", "swap", "exchange"]),
    st.integers(0, 10),
    st.integers(0, 10),
)


def falsified(change: Change) -> list[Point]:
    points = list(CHAIN)
    if change.name == "remove":
        del points[change.place]
    elif change.name == "alter":
        x, y, z = points[change.place].xyz_mm
        update = {"xyz_mm": (x, y, z + 1e-9)}
        points[change.place] = points[change.place].model_copy(update=update)
    elif change.name == "insert":
        points.insert(change.place, point(change.place))
    elif change.name == "move":
        points.insert(change.to, points.pop(change.place))
    elif change.name == "swap":
        first, other = points[change.place], points[change.to]
        names = {"seq", "id", "previous", "signature"}
        points[change.place] = first.model_copy(
            update={n: getattr(other, n) for n in names}
        )
    else:
        points[change.place] = OTHER[change.place]
    return points


@given(CHANGES)
def test_every_falsification_is_found(change: Change) -> None:
    points = falsified(change)
    if points != list(CHAIN):
        assert problems(points), change


@given(st.sampled_from(sorted(Point.model_fields)), st.integers(0, 11))
def test_every_field_is_signed(name: str, place: int) -> None:
    other = dict(signed(1, "elsewhere")[0])
    points = list(CHAIN)
    if other[name] != getattr(points[place], name):
        points[place] = points[place].model_copy(update={name: other[name]})
        assert problems(points)


def test_what_is_missing_is_numbered() -> None:
    points = list(CHAIN)
    (reported,) = problems([*points[:3], *points[6:]])
    assert (
        reported == "point 6 of session s: 3 to 5 before it is missing, or comes later"
    )
    (reported,) = problems(points[1:])
    assert reported == "point 1 of session s: 0 before it is missing, or comes later"
    assert problems(points[:-2]) == []  # no chain knows its end
    assert "is not signed" in problems([point(0)])[0]


def test_a_session_signed_anew_behind_another_point_does_not_follow() -> None:
    """Who has the key can sign anything, but not into a chain that was read."""
    signer = PointSigner(KEY)
    branch = [
        signer.signed(point(n, label=POINT.label, samples=n + 1)) for n in range(6)
    ]
    reported = problems([*CHAIN[:3], *branch[3:]])
    assert reported == ["point 3 of session s does not follow from the one before it"]
    (reported,) = problems([*CHAIN[:6], branch[2], *CHAIN[6:]])
    assert "another than the one read before" in reported


def test_points_that_were_not_stored_leave_no_gap() -> None:
    signer = PointSigner(KEY)
    kept = [signer.signed(point(0)), signer.signed(point(1))]
    lost = [
        signer.signed(point(2)),
        signer.signed(point(3)),
        signer.signed(point(0, "t")),
    ]
    for unstored in reversed(lost):
        signer.roll_back(unstored)
    kept += [signer.signed(point(2, samples=3)), signer.signed(point(0, "t"))]
    assert problems(kept) == []


def test_lines_that_are_no_points_are_named() -> None:
    lines = [encode(point, "json").decode() for point in CHAIN[:3]]
    checked = checked_points(points_of_lines([lines[0], "{", *lines[1:]]), PUBLIC)
    assert checked.n_points == 3
    (reported,) = checked.problems
    assert reported.startswith("line 2 is no point: ")


def test_keys_that_cannot_be_used(tmp_path) -> None:
    assert read_public_key(f"{b64encode(PUBLIC).decode()}\n") == PUBLIC
    for text in ("", "no key", b64encode(PUBLIC[1:]).decode()):
        with pytest.raises(ValueError, match=r"."):
            read_public_key(text)
    file = tmp_path / "key"
    file.write_bytes(b"no key")
    with pytest.raises(ValueError, match="can be read by others"):
        read_signer(file)
    file.chmod(0o600)
    with pytest.raises(ValueError, match="is no private key without a password"):
        read_signer(file)
