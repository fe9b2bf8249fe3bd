import pytest

from tests.kinematics.arms import ARM_TEXT
from traverse.kinematics.arm_file.arm import parse_arm
from traverse.kinematics.effect_table import EFFECT_KINDS
from traverse.strict_toml.problems import FileError

EPOCH = "epoch_utc = 2026-11-20T09:00:00Z\n"
# Written by hand from the table of the contract: class, keys of a good effect.
# The axis of J1 is along z, that of J2 along y.
GOOD = {
    "encoder_eccentricity": ("L", 'joint = "J1"\ncos_rad = 3.1e-5\nsin_rad = -1e-5'),
    "encoder_harmonic": (
        "L",
        'joint = "J1"\norder = 2\ncos_rad = 3.1e-5\nsin_rad = -1e-5',
    ),
    "transmission_error": (
        "L",
        'joint = "J1"\ncycles = 80.5\ncos_rad = 3.1e-5\nsin_rad = -1e-5',
    ),
    "encoder_scale": ("L", 'joint = "J1"\nscale_ppm = 12'),
    "encoder_temperature": ("L", 'joint = "J1"\nrate_rad_c = 1e-6'),
    "encoder_drift": ("A", f'joint = "J1"\nrate_rad_s = 1e-9\n{EPOCH}'),
    "count_slip": ("A", f'joint = "J1"\nat_s = 100.0\nstep_rad = 1e-4\n{EPOCH}'),
    "encoder_latency": ("L", "latency_s = 1e-5"),
    "backlash": ("L", 'joint = "J1"\nhalf_width_rad = 1e-5'),
    "joint_compliance": ("L", 'joint = "J2"\ncompliance_rad_nm = 2e-5'),
    "bearing_compliance": ("L", 'joint = "J2"\ncompliance_rad_nm = 2e-5'),
    "mount_compliance": ("L", "compliance_rad_nm = 2e-6"),
    "first_moment": ("L", 'joint = "J2"\nmoment_kg_m = [0.5, -0.1, 0]'),
    "thermal_expansion": ("L", 'joint = "J2"\nexpansion_per_c = 2.3e-5'),
    "axis_wobble": (
        "L",
        'joint = "J2"\norder = 2\ncos_rad = [1e-5, 0.0, 1e-6]\nsin_rad = [0, 0, 0]',
    ),
    "axis_runout": (
        "L",
        'joint = "J1"\ncomponent = "radial"\norder = 2\n'
        "cos_mm = [1e-3, 2e-3, 0.0]\nsin_mm = [0.0, 0.0, 0.0]",
    ),
    "probe_radius": ("D", "radius_error_mm = -0.002"),
    "probe_lobing": ("D", "amplitude_mm = 0.002\nphase_rad = 0.4"),
    "stylus_bending": ("D", "compliance_mm_n = 0.01"),
    "base_drift": ("A", f"rate_mm_s = [1e-6, 0.0, 0.0]\n{EPOCH}"),
    "base_step": ("A", f"at_s = 60\nstep_mm = [0.01, 0.0, 0.0]\n{EPOCH}"),
    "artefact_length": ("O", 'artefact = "bar"\nerror_ppm = 3.0'),
    "empirical": (
        "L",
        'joint = "J1"\ncovariate = "time_s"\nknots = [0.0, 1.0, 2.5]\n'
        "values_rad = [0.0, 1e-6, 0.0]",
    ),
}


def parse_with(kind, keys):
    return parse_arm(f'{ARM_TEXT}\n[[effects]]\nkind = "{kind}"\n{keys}\n')


def problems_of(kind, keys):
    with pytest.raises(FileError) as caught:
        parse_with(kind, keys)
    places = [problem.where for problem in caught.value.problems]
    return [place.removeprefix("effects[0].") for place in places]


def test_table_holds_exactly_the_kinds_of_the_contract():
    assert list(EFFECT_KINDS) == list(GOOD)


@pytest.mark.parametrize("kind", GOOD)
def test_good_effect_of_each_kind_is_read(kind):
    effect_class, keys = GOOD[kind]
    [effect] = parse_with(kind, keys).effects
    assert effect.kind == kind
    assert EFFECT_KINDS[kind].effect_class == effect_class
    assert effect.joint == (
        "J1" if '"J1"' in keys else "J2" if '"J2"' in keys else None
    )
    assert (effect.epoch_utc is not None) == (effect_class == "A")


@pytest.mark.parametrize("kind", GOOD)
def test_each_key_of_each_kind_is_required_and_typed(kind):
    lines = GOOD[kind][1].split("\n")
    optional = {"encoder_latency": "joint", "thermal_expansion": "joint"}
    for line in filter(None, lines):
        key = line.split(" = ")[0]
        without_key = "\n".join(other for other in lines if other != line)
        if optional.get(kind) == key:
            parse_with(kind, without_key)
        else:
            assert problems_of(kind, without_key) == [key]
        [place] = problems_of(kind, f"{without_key}\n{key} = {{ wrong = 1 }}")
        assert place == key


@pytest.mark.parametrize("kind", GOOD)
def test_foreign_keys_are_refused_in_each_kind(kind):
    keys = GOOD[kind][1]
    assert problems_of(kind, f"{keys}\nwhatever_mm = 1.0") == ["whatever_mm"]
    if "epoch_utc" not in keys:
        assert problems_of(kind, f"{keys}\n{EPOCH}") == ["epoch_utc"]
    if EFFECT_KINDS[kind].joint == "absent":
        assert problems_of(kind, f'{keys}\njoint = "J1"') == ["joint"]
    elif "joint" in keys:
        unknown = keys.replace('"J1"', '"J9"').replace('"J2"', '"J9"')
        assert problems_of(kind, unknown) == ["joint"]


def changed(kind, old, new):
    keys = GOOD[kind][1]
    assert old in keys
    return keys.replace(old, new)


@pytest.mark.parametrize(
    ("kind", "old", "new", "where"),
    [
        ("encoder_harmonic", "order = 2", "order = 1", "order"),
        ("transmission_error", "cycles = 80.5", "cycles = 0.0", "cycles"),
        ("transmission_error", "cycles = 80.5", "cycles = 400.5", "cycles"),
        ("encoder_harmonic", "order = 2", "order = 2.0", "order"),
        ("encoder_harmonic", "order = 2", "order = true", "order"),
        ("axis_wobble", "order = 2", "order = 1", "order"),
        ("axis_runout", "order = 2", "order = 1", "order"),
        ("axis_runout", '"radial"', '"tangential"', "component"),
        ("axis_runout", "[1e-3, 2e-3, 0.0]", "[1e-3, 2e-3, 1e-8]", "cos_mm"),
        ("axis_wobble", "[0, 0, 0]", "[0, 1e-300, 0]", "sin_rad"),
        ("axis_wobble", "[0, 0, 0]", "[0, 0]", "sin_rad"),
        ("axis_wobble", "[0, 0, 0]", "[0, 0, nan]", "sin_rad[2]"),
        ("empirical", "[0.0, 1.0, 2.5]", "[0.0, 1.0, 1.0]", "knots"),
        ("empirical", "[0.0, 1.0, 2.5]", "[0.0, 1.0]", "values_rad"),
        ("empirical", "[0.0, 1e-6, 0.0]", "[0.0, 1e-6]", "values_rad"),
        ("empirical", "[0.0, 1e-6, 0.0]", '[0.0, "1", 0.0]', "values_rad[1]"),
        ("base_drift", "00Z", "00", "epoch_utc"),
    ],
)
def test_values_out_of_range_are_refused(kind, old, new, where):
    assert problems_of(kind, changed(kind, old, new)) == [where]


def test_spline_needs_two_knots():
    keys = changed("empirical", "[0.0, 1.0, 2.5]", "[0.0]")
    keys = keys.replace("[0.0, 1e-6, 0.0]", "[0.0]")
    assert problems_of("empirical", keys) == ["knots"]


def test_axial_runout_lies_along_the_axis_and_may_be_of_first_order():
    axial = (
        'joint = "J2"\ncomponent = "axial"\norder = 1\n'
        "cos_mm = [0.0, -1e-3, 0.0]\nsin_mm = [0.0, 0.0, 0.0]"
    )
    parse_with("axis_runout", axial)
    assert problems_of("axis_runout", axial.replace("order = 1", "order = 0")) == [
        "order"
    ]
    across = axial.replace("[0.0, -1e-3, 0.0]", "[1e-3, 0.0, 0.0]")
    assert problems_of("axis_runout", across) == ["cos_mm"]
