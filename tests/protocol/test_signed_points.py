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

# Two points, signed by a version whose points had no `time_bound_ns`.
OLD_POINT = (
    '{"schema":"traverse/point/1","session":"s","seq":SEQ,"id":"s-SEQ","retracts":nul'
    'l,"arm":"bench-7","model":"sha256:9f86d081884c7d659f86d081884c7d659f86d081884c7d'
    '659f86d081884c7d65","trigger":"button","time_ns":"1795251247123456789","xyz_mm":'
    '[612.25,-80.5,301.125],"ijk":[0.6,0.0,-0.8],"surface_mm":[614.05,-80.5,298.725],'
    '"compensation":"shank","part_xyz_mm":null,"covariance_mm2":[0.0001,0.0,0.00002,0'
    '.00015,0.0,0.000225],"angles_rad":[0.1,-0.5,1.25,0.0,2.5,-1.75,3.0],"counts":[13'
    '3502,-667510,1668776,0,3337552,-2336286,4005062],"temperature_c":20.5,"probe_rad'
    'ius_mm":3.0,"samples":25,"spread_mm":0.0042,"label":{"artefact":"bar","feature":'
    '"1"},"quality":{"ok":false,"flags":["overspeed","empirical"]},"previous":"PREVIO'
    'US","signature":"SIGNATURE"}'
)
BEFORE = tuple(
    OLD_POINT.replace("SEQ", seq)
    .replace("PREVIOUS", previous)
    .replace("SIGNATURE", signature)
    .encode()
    for seq, previous, signature in (
        (
            "0",
            "043a718774c572bd8a25adbeb1bfcd5c0256ae11cecf9f9c3f925d0e52beaf89",
            "GcNtMEwvI0EDvafnDnyIZCmPtBV51GIvWRMom9kE7Rn2"
            "Q/CyJe/CyprMEMiWinahtx1dZhcUGf8c9ddDH35TBg==",
        ),
        (
            "1",
            "85bed1741bce3fb309424bb90e7e0f3754d1540d403a5770e5540a3de06b9db4",
            "y7ImeBh/+ZfnhwEmmg12zN0PUg23klHaZexUUO2WhQdU"
            "cVaBV4mp8VYOrvE54tEwlrutBBiT6kHXgKVL4YL3BQ==",
        ),
    )
)


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
    signer = PointSigner(KEY)
    unstated = [signer.signed(point(seq, time_bound_ns=None)) for seq in range(3)]
    for whole in (CHAIN, unstated):
        check_by_the_page(whole)


def check_by_the_page(points) -> None:
    before = hashlib.sha256(b"s").hexdigest()
    key = Ed25519PublicKey.from_public_bytes(PUBLIC)
    for point in points:
        fields = json.loads(encode(point, "json"))
        values = msgpack.unpackb(encode(point, "msgpack"))
        assert list(values) == list(fields)
        signature = values["signature"]
        assert values["previous"] == before
        values["signature"] = None
        if values["time_bound_ns"] is None:
            del values["time_bound_ns"]
        content = msgpack.packb(values)
        before = hashlib.sha256(content).hexdigest()
        padded = signature.encode()
        import base64  # noqa: PLC0415

        key.verify(base64.b64decode(padded), content)


def test_points_that_were_signed_before_they_stated_the_bound_of_their_time() -> None:
    points = [decode(Point, line) for line in BEFORE]
    assert len(points) == 2
    assert problems(points) == []
    for encoding in ("json", "msgpack"):
        again = [decode(Point, encode(point, encoding)) for point in points]
        assert problems(again) == []
    bounded = points[0].model_copy(update={"time_bound_ns": 0})
    assert problems([bounded]) == [
        "point 0 of session s was altered, or signed by another key"
    ]
    # The chain goes on from points of before.
    signer = PointSigner(KEY)
    unstated = [signer.signed(point(seq, time_bound_ns=None)) for seq in range(2)]
    assert unstated == points
    assert problems([*points, signer.signed(point(2))]) == []


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
