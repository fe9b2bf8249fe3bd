"""Scanned spheres and flats: figures that can be computed by hand."""

import numpy as np
import pytest

from tests.docs.pages import CHECKOUT
from tests.lab.measurements import (
    SURE_MM,
    TIP_MM,
    artefact,
    limits,
    measured,
    of_kind,
    on_a_ball,
    touches,
)
from traverse.kinematics.arm_file.arm import read_arm
from traverse.lab.acceptance.administration import administration_of
from traverse.lab.acceptance.conformity import Figure, Missing, Scatter
from traverse.lab.acceptance.procedures.scanning import (
    narrowest_mm,
    representatives,
    scanning,
)
from traverse.lab.acceptance.standards import STANDARDS
from traverse.lab.acceptance.statements import absent_statements
from traverse.simulator.campaigns.acceptance.layout import PATTERN_25, spiral

CENTRE = np.array([300.0, -200.0, 100.0])
N = 400


def sphere(name="scan-sphere", **keys):
    known = {"radius_mm": 10.0, "radius_std_mm": SURE_MM}
    return artefact(name, "sphere", **{**known, **keys})


def scan(off_mm=0.0, opening_deg=90.0, n=N, towards=(0.0, 0.0, 1.0)):
    """A scan over a cap, each point so far outside of the ball."""
    pole = np.array(towards) / np.linalg.norm(towards)
    upright = spiral(n, opening_deg)
    # Reflect the third axis onto the pole.
    across = pole - [0.0, 0.0, 1.0]
    if np.linalg.norm(across) > 0.0:
        across = across / np.linalg.norm(across)
        upright = upright - 2.0 * np.outer(upright @ across, across)
    away = 10.0 + TIP_MM + np.broadcast_to(off_mm, n)
    return CENTRE + away[:, np.newaxis] * upright


def of_sphere(places, artefact_of=None, **mpe):
    ball = artefact_of or sphere()
    data = measured((ball, touches(places, [""] * len(places))))
    return list(scanning(data, limits(**mpe)))


@pytest.mark.parametrize("n", [20, 100, 101])
def test_the_narrowest_interval_is_the_one_that_a_search_finds(n):
    rng = np.random.default_rng(n)
    heights = rng.standard_normal(n)
    held = next(k for k in range(n + 1) if k >= 0.95 * n)
    widths = [
        high - low
        for low in heights
        for high in heights
        if np.sum((heights >= low) & (heights <= high)) == held
    ]
    assert narrowest_mm(heights) == pytest.approx(min(widths))


def test_a_few_outliers_are_in_the_form_of_no_95_percent():
    off = np.zeros(N)
    off[::40] = 0.020  # 10 of 400 lie 20 um outside, evenly
    parts = of_sphere(scan(off))
    form = of_kind(parts, Figure, "scan_form_95")
    size = of_kind(parts, Figure, "scan_size_all")
    assert form.value_mm < 0.0035
    # Ten of 400 draw the least-squares radius outwards by a fortieth of 20 um.
    assert size.value_mm == pytest.approx(2 * 0.020 / 40, abs=5e-4)
    (scatter,) = of_kind(parts, Scatter)
    assert np.ptp(scatter.deviations_mm) == pytest.approx(0.020, abs=1e-3)


def test_a_larger_ball_is_in_the_size_alone():
    parts = of_sphere(scan(0.004), scan_size_all_mm=0.009, scan_size_25_mm=0.007)
    for key in ("scan_size_25", "scan_size_all"):
        assert of_kind(parts, Figure, key).value_mm == pytest.approx(0.008, abs=1e-9)
    for key in ("scan_form_25", "scan_form_95"):
        assert of_kind(parts, Figure, key).value_mm == pytest.approx(0.0, abs=1e-9)
    assert of_kind(parts, Figure, "scan_size_all").decision.verdict == "accept"
    assert of_kind(parts, Figure, "scan_size_25").decision.verdict == "reject"
    assert all(figure.confirm for figure in of_kind(parts, Figure))


def test_25_points_are_those_next_to_the_pattern():
    # Dense enough that each direction has a point within two degrees.
    cloud = scan(n=4000, towards=(1.0, 1.0, 0.0))
    outwards = cloud - CENTRE
    rows = representatives(outwards, "scan-sphere")
    assert len(set(rows)) == 25
    chosen = outwards[rows] / np.linalg.norm(outwards[rows], axis=1, keepdims=True)
    # Angles between them are those of the pattern, wherever its pole is.
    cosines, expected = (np.sort((u @ u.T).ravel()) for u in (chosen, PATTERN_25))
    assert np.abs(cosines - expected).max() < 0.12
    pole = chosen.mean(axis=0) / np.linalg.norm(chosen.mean(axis=0))
    assert pole @ np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0) > np.cos(np.radians(3.0))


def test_where_the_probe_stays_the_pole_is_not_drawn():
    even = scan()
    dwelling = on_a_ball(CENTRE, 10.0, np.tile([1.0, 0.0, 0.0], (3000, 1)))
    without_stay = representatives(even - CENTRE, "")
    with_stay = representatives(np.vstack([even, dwelling]) - CENTRE, "")
    assert len(set(with_stay)) == 25
    middles = [
        np.vstack([even, dwelling])[rows].mean(axis=0)
        for rows in (without_stay, with_stay)
    ]
    assert np.linalg.norm(middles[1] - middles[0]) < 2.5


@pytest.mark.parametrize(
    ("places", "message"),
    [
        (scan(n=199), "199 points, expected at least 200"),
        (scan(opening_deg=60.0), "of 25 directions; scan the whole half sphere"),
    ],
)
def test_what_is_no_scan_of_a_half_sphere_is_said(places, message):
    parts = of_sphere(places)
    assert not of_kind(parts, Figure)
    missing = of_kind(parts, Missing)
    assert [part.name for part in missing] == [
        "P_Form.Sph.1x25",
        "P_Form.Sph.D95%",
        "P_Size.Sph.1x25",
        "P_Size.Sph.All",
        "L_Dia.5x5",
        "E_Form.Pla.D95%",
    ]
    assert message in missing[0].what[0]


def test_a_sphere_of_unusual_size_is_remarked():
    ball = sphere(radius_mm=4.0)
    parts = of_sphere(scan(-6.0), ball)
    assert "8 mm, expected 10 to 51 mm" in of_kind(parts, Figure)[0].remarks[0]


def test_location_of_five_scans_by_hand():
    # Centres on a line, 4 um from end to end.
    offsets = 1e-3 * np.array([[-2, 0, 0], [2, 0, 0], [0, 0, 0], [1, 0, 0], [-1, 0, 0]])
    places = np.concatenate([scan(n=60) + offset for offset in offsets])
    features = [group for group in "ABCDE" for _ in range(60)]
    data = measured((sphere("scan-articulated"), touches(places, features)))
    parts = list(scanning(data, limits()))
    assert of_kind(parts, Figure, "scan_l_dia").value_mm == pytest.approx(
        0.004, abs=1e-8
    )
    few = measured((sphere("scan-articulated"), touches(places[::3], features[::3])))
    missing = of_kind(list(scanning(few, limits())), Missing)
    assert "group A: 20 points, expected at least 25" in missing[4].what[0]


def flat(off_mm, **keys):
    """A scan of a tilted flat of 60 mm, each point so far above it."""
    rng = np.random.default_rng(4)
    normal = np.array([0.0, 0.6, 0.8])
    sides = np.array([[1.0, 0.0, 0.0], [0.0, 0.8, -0.6]])
    places = rng.uniform(-30.0, 30.0, (len(off_mm), 2)) @ sides
    places += np.asarray(off_mm)[:, np.newaxis] * normal
    return measured(
        (artefact("scan-flat", "plane", **keys), touches(places, [""] * len(places)))
    )


def test_a_flat_by_hand():
    # 300 points: nine in ten on the plane, 3 % 10 um above, 7 % 6 um below.
    off = np.zeros(300)
    off[:9], off[9:30] = 0.010, -0.006
    data = flat(np.random.default_rng(5).permutation(off), form_mm=0.001)
    permitted = limits(scan_flat_95_mm=0.007, standards={"fixture_std_mm": 3e-4})
    parts = list(scanning(data, permitted))
    figure = of_kind(parts, Figure, "scan_flat_95")
    # Without the 3 % and 2 % of the others: from the plane to 6 um below.
    assert figure.value_mm == pytest.approx(0.006, abs=5e-4)
    assert dict(figure.parts)["all points"] == pytest.approx(0.016, abs=5e-4)
    assert figure.budget.standard_mm == pytest.approx(np.hypot(5e-4, 3e-4))


def test_a_verdict_on_scanning_rests_on_an_agreement_and_on_the_flat():
    arm = read_arm(CHECKOUT / "cli" / "demo_data" / "arm.toml")
    data = flat(np.zeros(300), form_mm=0.001, serial_number="E 1")
    agreed = limits().model_copy(update={"agreement": "contract 4"})
    for permitted, is_agreed in ((limits(), False), (agreed, True)):
        stated = administration_of([data], arm, permitted)
        absent = {
            standard: {
                each.code: each
                for each in absent_statements(standard, stated, "2026-11-21")
            }
            for standard in STANDARDS
        }
        assert ("agreement" in absent["iso10360-8"]) is not is_agreed
        assert "agreement" not in absent["iso10360-12"]
        # The flat's certificate lacks statements; its expansion is not required.
        assert absent["iso10360-8"]["certificate_number"].names == ("plane E 1",)
        assert "expansion" not in absent["iso10360-8"]
        assert "measuring_range" not in absent["iso10360-8"]
    unknown = flat(np.zeros(300))
    assert administration_of([unknown], arm, limits()).standards == ()


def test_a_sensor_has_no_ball():
    arm = read_arm(CHECKOUT / "cli" / "demo_data" / "arm.toml")
    data = flat(np.zeros(300), form_mm=0.001)
    assert administration_of([data], arm, limits()).probe_diameter_mm == 2.0 * TIP_MM
    data.touched["scan-flat"].tip_mm[:] = 0.0
    assert administration_of([data], arm, limits()).probe_diameter_mm == 0.0
    # Of several tips the arm file's counts.
    data.touched["scan-flat"].tip_mm[:5] = 1.0
    stated = administration_of([data], arm, limits())
    assert stated.probe_diameter_mm == 2.0 * arm.probe.radius_mm


def test_a_flat_without_a_certified_form_decides_nothing():
    parts = list(scanning(flat(np.zeros(300)), limits(scan_flat_95_mm=0.01)))
    figure = of_kind(parts, Figure, "scan_flat_95")
    assert figure.decision.verdict == "undecided"
    assert "form_mm of the plane" in figure.budget.lines[0].formula
    cone = measured((artefact("scan-flat", "cone"), touches([], [])))
    missing = of_kind(scanning(cone, limits()), Missing)[-1]
    assert missing.what == ("scan-flat: is cone, expected a plane",)


def test_lengths_between_scanned_balls_by_hand():
    # Seven positions of five bars, three times: the third repeat of one is 6 um long.
    pairs = []
    for position in range(1, 8):
        for number in range(1, 6):
            name, length_mm = f"scan-uni-{position}-{number}", 200.0 * number
            bar = artefact(
                name,
                "ball_bar",
                radius_mm=10.0,
                distance_mm=length_mm,
                distance_std_mm=SURE_MM,
            )
            places, features = [], []
            for repeat in range(3):
                off = 0.006 if (name, repeat) == ("scan-uni-4-2", 2) else 0.0
                for end, along_mm in (("1", 0.0), ("2", length_mm + off)):
                    places.append(scan(n=30) + np.array([0.0, along_mm, 0.0]))
                    features += [end] * 30
            pairs.append((bar, touches(np.concatenate(places), features)))
    permitted = limits(scan_e_uni_mm=0.004, standards={"form_mm": 0.0006})
    parts = list(scanning(measured(*pairs), permitted))
    figure = of_kind(parts, Figure, "scan_e_uni")
    assert figure.value_mm == pytest.approx(0.006, abs=1e-7)
    assert figure.decision.verdict == "neither"
    assert "measure each ten times again" in figure.remarks[0]
    # However many points, the ball is out of round by as much.
    assert figure.budget.standard_mm == pytest.approx(0.31 * 0.0006, rel=1e-3)
    assert not [part for part in parts if getattr(part, "key", "") == "scan_e_bi"]
