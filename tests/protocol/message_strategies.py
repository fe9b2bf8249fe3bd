import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of

from traverse.protocol.messages import (
    Clock,
    Command,
    Event,
    Expiry,
    Label,
    Live,
    Message,
    Point,
    Quality,
    Reply,
    ReplyError,
    Scan,
)

LARGEST = 2**53 - 1
names = st.text(min_size=1, max_size=64)
texts = st.text(max_size=50)
arms = st.text(
    st.characters(exclude_characters="/+#\0", exclude_categories=["Cs"]),
    min_size=1,
    max_size=64,
)
codes = st.from_regex(r"[a-z][a-z0-9_]{0,20}(\.[a-z0-9_]{1,10}){1,2}", fullmatch=True)
numbers = st.floats(allow_nan=False, allow_infinity=False)
not_negative = st.floats(0.0, allow_infinity=False)
integers = st.integers(-LARGEST, LARGEST)
natural = st.integers(0, LARGEST)
times = st.integers(0, 2**63 - 1)
vectors = st.tuples(numbers, numbers, numbers)
covariances = st.tuples(*[numbers] * 6)
plain = st.recursive(
    st.none() | st.booleans() | integers | numbers | texts,
    lambda inner: (
        st.lists(inner, max_size=4).map(tuple)
        | st.dictionaries(names, inner, max_size=4)
    ),
    max_leaves=8,
)
maps = st.dictionaries(names, plain, max_size=5)
qualities = st.integers(0, 2**32 - 1).map(Quality.from_bits)
labels = st.builds(Label, artefact=names, feature=st.none() | names) | st.just(Label())


@st.composite
def points(draw) -> Point:
    n_joints = draw(st.integers(0, 8))
    side = draw(st.sampled_from(["none", "shank", "pretouch", "pulled", "inside"]))
    point_id = draw(names)
    return Point(
        session=draw(names),
        seq=draw(natural),
        id=point_id,
        retracts=draw(st.none() | names.filter(lambda name: name != point_id)),
        arm=draw(arms),
        model=draw(names),
        trigger=draw(st.sampled_from(["button", "switch", "timer", "command"])),
        time_ns=draw(times),
        time_bound_ns=draw(st.none() | natural),
        xyz_mm=draw(vectors),
        ijk=draw(vectors),
        surface_mm=None if side == "none" else draw(vectors),
        compensation=side,
        part_xyz_mm=draw(st.none() | vectors),
        covariance_mm2=draw(st.none() | covariances),
        angles_rad=draw(st.tuples(*[numbers] * n_joints)),
        counts=draw(st.tuples(*[integers] * n_joints)),
        temperature_c=draw(st.none() | numbers),
        probe_radius_mm=draw(not_negative),
        samples=draw(st.integers(1, 1_000_000)),
        spread_mm=draw(st.none() | not_negative),
        label=draw(labels),
        quality=draw(qualities),
    )


def _rows(n: int, columns: int) -> st.SearchStrategy[np.ndarray]:
    return arrays_of.arrays(np.float64, (n, columns), elements=numbers)


@st.composite
def scans(draw) -> Scan:
    n, n_joints = draw(st.integers(0, 6)), draw(st.integers(1, 8))
    total = draw(st.none() | natural)
    bits = st.integers(0, 2**32 - 1)
    limits = {"min_value": -LARGEST, "max_value": LARGEST}
    steps = draw(st.lists(st.integers(0, 2**50), min_size=n, max_size=n))
    return Scan(
        session=draw(names),
        scan=draw(names),
        seq=draw(natural),
        arm=draw(arms),
        model=draw(names),
        mode=draw(st.sampled_from(["time", "distance", "planes"])),
        rate_hz=draw(st.none() | st.floats(0.1, 1e4)),
        probe_radius_mm=draw(not_negative),
        time_ns=draw(times),
        dtime_ns=np.cumsum(np.array(steps, np.int64)),
        xyz_mm=draw(_rows(n, 3)),
        ijk=draw(_rows(n, 3)),
        angles_rad=draw(_rows(n, n_joints)),
        counts=draw(
            st.none()
            | arrays_of.arrays(np.int64, (n, n_joints), elements=st.integers(**limits))
        ),
        part_xyz_mm=draw(st.none() | _rows(n, 3)),
        covariance_mm2=draw(st.none() | _rows(n, 6)),
        quality=draw(arrays_of.arrays(np.uint32, (n,), elements=bits)),
        dropped=draw(natural),
        lost=draw(natural),
        last=total is not None,
        total=total,
        in_doubt=draw(natural),
    )


lives = st.builds(
    Live,
    arm=arms,
    model=names,
    session=st.none() | names,
    time_ns=times,
    xyz_mm=vectors,
    ijk=vectors,
    part_xyz_mm=st.none() | vectors,
    covariance_mm2=st.none() | covariances,
    angles_rad=st.lists(numbers, max_size=8).map(tuple),
    skeleton_mm=st.none() | st.lists(vectors, max_size=8).map(tuple),
    speed_mm_s=st.none() | not_negative,
    probe_radius_mm=not_negative,
    inputs=st.lists(names, max_size=4).map(tuple),
    quality=qualities,
)


@st.composite
def events(draw) -> Event:
    """Events of any severity, momentary, raised or cleared."""
    first_ns, last_ns = sorted([draw(times), draw(times)])
    return Event(
        arm=draw(arms),
        session=draw(st.none() | names),
        severity=draw(st.sampled_from(["info", "warning", "error"])),
        code=draw(codes),
        text=draw(texts),
        remedy=draw(texts),
        source=draw(names),
        active=draw(st.none() | st.booleans()),
        first_ns=first_ns,
        last_ns=last_ns,
        count=draw(st.integers(1, LARGEST)),
        data=draw(maps),
    )


clocks = st.builds(Clock, arm=arms, clock=names, now_ns=times)
expiries = st.builds(Expiry, clock=names, at_ns=times)
commands = st.builds(Command, request=names, args=maps, expires=st.none() | expiries)
refusals = st.builds(ReplyError, code=codes, text=texts, remedy=texts)
replies = st.builds(Reply, request=names, ok=st.just(True), result=maps) | st.builds(
    Reply, request=names, ok=st.just(False), error=refusals
)
messages: st.SearchStrategy[Message] = st.one_of(
    points(), scans(), lives, events(), clocks, commands, replies
)
