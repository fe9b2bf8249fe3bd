"""The zoo of robot descriptions: its own walk, and its verdicts."""

import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.zoo import walk
from benchmarks.zoo.__main__ import Case, Tally, _compared, judge
from traverse.kinematics.importers.urdf_chain import Holds

PLAIN = """<robot name="r"><link name="a"/><link name="b"/><link name="c"/>
<drake:thing/><joint name="J 1" type="continuous"><parent link="a"/><child link="b"/>
<origin xyz="0 0 0.5" rpy="0 0 1.5707963267948966"/><axis xyz="0 0 2"/></joint>
<joint name="J2" type="revolute"><parent link="b"/><child link="c"/>
<origin xyz="0.25 0 0"/><axis xyz="0 1 0"/></joint></robot>
"""
FILES = {
    "right": PLAIN,
    "held": PLAIN.replace('"revolute"', '"prismatic"'),
    "mimic": PLAIN.replace('<axis xyz="0 1 0"/>', '<mimic joint="J 1"/>'),
    "elsewhere": PLAIN.replace('<axis xyz="0 1 0"/>', '<mimic joint="none"/>'),
    "floating": PLAIN.replace('"revolute"', '"floating"'),
    "torn": PLAIN[:-20],
    "twice": PLAIN.replace('"c"/>\n<drake', '"b"/>\n<drake'),
}
OUTCOMES = {
    "right": "right",
    "held": "refused clearly, right where held",
    "mimic": "right",
    "elsewhere": "refused clearly, right where held",
    "floating": "refused clearly",
    "torn": "refused clearly",
    "twice": "refused clearly",
}


def written(tmp_path: Path, name: str) -> Path:
    path = tmp_path / f"{name}.urdf"
    path.write_text(FILES[name], "utf-8")
    return path


def test_the_walk_is_the_product_of_its_transforms(tmp_path: Path) -> None:
    every = walk.read(written(tmp_path, "right"))
    assert list(every.ends()) == ["c"]
    # A quarter turn and 0.3 rad more about z, then 0.25 m along x.
    place_mm = walk.place_mm(every.chain("c"), {"J 1": 0.3, "J2": 9.0}, every)
    expected = [-250 * math.sin(0.3), 250 * math.cos(0.3), 500]
    np.testing.assert_allclose(place_mm, expected, atol=1e-12)


@pytest.mark.parametrize("name", FILES)
def test_a_description_is_judged(tmp_path: Path, name: str) -> None:
    tally = Tally()
    judge(written(tmp_path, name), tally, np.random.default_rng(1))
    assert tally.complaints == []
    assert dict(tally.outcomes) == {OUTCOMES[name]: 1}


def test_an_arm_that_is_elsewhere_is_wrong(tmp_path: Path) -> None:
    path = written(tmp_path, "right")
    every = walk.read(path)
    case = Case(path, every, every.chain("c"), np.random.default_rng(1))
    made = case.imported(Holds())
    path.write_text(PLAIN.replace("0.25 0 0", "0.2501 0 0"), "utf-8")
    other, tally = walk.read(path), Tally()
    moved = Case(path, other, other.chain("c"), case.rng)
    assert _compared(moved, made, Holds(), tally) == "wrong"
    assert tally.complaints[0].endswith(" mm off")
    assert tally.largest_mm == pytest.approx(0.1, rel=0.5)
