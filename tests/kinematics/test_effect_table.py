import ast
from functools import cache
from pathlib import Path

import pytest

from traverse.kinematics.effect_table import EFFECT_KINDS, Family, key_unit
from traverse.kinematics.effects import effect_class
from traverse.kinematics.effects.base.correction import (
    ContactCorrection,
    ReadingCorrection,
)

ROOT = Path(__file__).parents[2]
# The simulator has its own laws, and draws from its own sizes.
ASKING = ("lab", "cli", "daemon", "client", "kinematics", "recording", "protocol")
# Flags of a pose have the name of the one kind that sets them.
FLAGS = {
    "cli/daily_check.py": {"empirical"},
    "daemon/pose/pipeline.py": {"empirical"},
    "kinematics/effects/base/correction.py": {"empirical"},
    "kinematics/effects/pose.py": {"empirical"},
    "kinematics/effects/readings/empirical.py": {"empirical"},
}


@cache
def strings_of(path: Path) -> list[str]:
    """Strings of a module, but for its docstrings and `kind: ClassVar`."""
    tree = ast.parse(path.read_text("utf-8"))
    docstrings = {
        id(node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.AnnAssign)
        and isinstance(node.target, ast.Name)
        and node.target.id == "kind"
    }
    return [
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and id(node) not in docstrings
    ]


@cache
def modules() -> list[Path]:
    paths = [path for top in ASKING for path in sorted((ROOT / top).rglob("*.py"))]
    return [path for path in paths if path.name != "effect_table.py"]


def test_nobody_but_the_table_and_the_effect_itself_names_a_kind():
    assert len(modules()) > 400
    named_kinds = {}
    for path in modules():
        name = path.relative_to(ROOT).as_posix()
        named = {text for text in strings_of(path) if text in EFFECT_KINDS}
        named -= FLAGS.get(name, set())
        if named:
            named_kinds[name] = named
    assert named_kinds == {}


@pytest.mark.parametrize("part", ["encoder_", "axis_", "_compliance"])
def test_nobody_takes_a_kind_to_pieces(part):
    """`kind.startswith("encoder_")` knows kinds as much as naming them does."""
    assert [path for path in modules() if part in strings_of(path)] == []


def test_rows_are_those_of_the_classes():
    for kind in EFFECT_KINDS:
        law = effect_class(kind)
        assert law.__name__ == kind.title().replace("_", ""), "found by its name"


@pytest.mark.parametrize("kind", EFFECT_KINDS)
def test_a_row_says_what_its_class_does(kind):
    row, law = EFFECT_KINDS[kind], effect_class(kind)
    assert (row.family is Family.GRAVITY) == law.uses_gravity
    assert (row.family is Family.CONTACT) == (issubclass(law, ContactCorrection))
    if issubclass(law, ReadingCorrection):
        assert row.acts_on == "angle"


@pytest.mark.parametrize("kind", EFFECT_KINDS)
def test_a_row_answers_every_question(kind):
    row = EFFECT_KINDS[kind]
    assert row.size > 0.0
    assert row.label
    for order in (None, 2, 3, 4, 5, 60):
        assert 0.0 < row.plausible_size(order) <= 20.0
        assert -40.0 < row.preference("J1", order) <= 0.0
    for key, of in row.keys.items():
        if of is float and key not in ("at_s", "cycles"):
            assert key_unit(key)
    for column in row.columns("J1") + row.columns(None):
        assert "{" not in column
    assert (row.joint == "optional") == (row.whole_arm_label is not None)
    assert row.phase is None or row.phase in row.keys


def test_a_key_without_a_unit_is_refused():
    with pytest.raises(ValueError, match="has no unit"):
        key_unit("loudness_db")


# Recorded from the functions that the table replaced, before it did.
SIZES = {
    "encoder_eccentricity": {None: 3e-5},
    "encoder_harmonic": {2: 2e-5, 3: 1e-5, 4: 1e-5, 5: 5e-6, 60: 5e-6},
    "transmission_error": {None: 2e-5},
    "encoder_scale": {None: 20.0},
    "encoder_temperature": {None: 1e-5},
    "encoder_drift": {None: 3e-5},
    "count_slip": {None: 5e-5},
    "encoder_latency": {None: 1e-4},
    "backlash": {None: 1e-5},
    "joint_compliance": {None: 1e-5},
    "bearing_compliance": {None: 1e-5},
    "mount_compliance": {None: 1e-5},
    "thermal_expansion": {None: 1e-5},
    "axis_wobble": {2: 1e-5, 5: 1e-5},
    "axis_runout": {1: 0.01, 4: 0.01},
    "probe_radius": {None: 0.01},
    "probe_lobing": {None: 0.005},
    "stylus_bending": {None: 0.01},
    "base_drift": {None: 0.03},
    "base_step": {None: 0.03},
    "artefact_length": {None: 10.0},
    "empirical": {None: 1e-5},
}
PRIORS = {
    "encoder_harmonic": {2: -1.0, 3: -2.0, 4: -3.0, 5: -3.0, 60: -3.0},
    "transmission_error": {None: -1.0},
    "encoder_temperature": {None: -0.5},
    "encoder_latency": {None: -0.7},
    "bearing_compliance": {None: -0.5},
    "thermal_expansion": {None: -0.7},
    "axis_wobble": {2: -1.0, 3: -1.5, 4: -2.0},
    "axis_runout": {1: -1.0, 2: -1.0, 3: -1.5, 4: -2.0},
}


@pytest.mark.parametrize("kind", SIZES)
def test_sizes_and_preferences_are_those_on_record(kind):
    row = EFFECT_KINDS[kind]
    for order, size in SIZES[kind].items():
        assert row.plausible_size(order) == size
    for order, prior in PRIORS.get(kind, {None: 0.0}).items():
        assert row.preference("J1", order) == prior
    if kind in ("encoder_latency", "thermal_expansion"):
        assert row.preference(None, None) == 0.0


def test_drifts_are_sizes_of_a_campaign():
    assert [k for k, row in EFFECT_KINDS.items() if row.is_size_of_campaign] == [
        "encoder_drift",
        "base_drift",
    ]
