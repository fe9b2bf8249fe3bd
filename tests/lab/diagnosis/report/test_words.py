"""Names, numbers with units, and the sentences of a diagnosis."""

from dataclasses import replace

import pytest

from tests.lab.diagnosis.diagnosed import clean, drifting, eccentric
from traverse.kinematics.arm_file.arm import effect_from_table
from traverse.lab.diagnosis.report.files import WORDS, summary_lines
from traverse.lab.diagnosis.report.names import (
    candidate_label,
    detectable_lines,
    joint_rows,
    term_size,
    term_size_text,
)
from traverse.lab.diagnosis.report.outcome import diagnosis_json
from traverse.lab.diagnosis.report.pictures import conditions
from traverse.lab.outcomes.candidate import BankName, Candidate
from traverse.lab.outcomes.diagnosis import Alternative, Detectable, Estimate, Size
from traverse.lab.report.quantities import odds, probability_of_log, quantity


def candidate(kind, joint=None, **more) -> Candidate:
    values = {
        "order": None,
        "component": None,
        "covariate": None,
        "artefact": None,
        "at_s": None,
    }
    return Candidate(
        bank=BankName.LIBRARY,
        kind=kind,
        joint=joint,
        parameters=("x",),
        scales=(1.0,),
        log_prior=0.0,
        **{**values, **more},
    )


@pytest.mark.parametrize(
    ("made", "text"),
    [
        (candidate("encoder_eccentricity", "J3"), "encoder eccentricity, joint J3"),
        (
            candidate("axis_runout", "J5", order=2, component="radial"),
            "radial runout twice a turn, joint J5",
        ),
        (candidate("thermal_expansion"), "thermal expansion of all links"),
        (
            candidate("thermal_expansion", "J3"),
            "thermal expansion of the link, joint J3",
        ),
        (candidate("artefact_length", artefact="bar"), "length of bar"),
        (
            candidate("count_slip", "J2", at_s=412.04),
            "jump of the encoder's zero, joint J2, at 412.0 s",
        ),
        (
            candidate("empirical", "J4", covariate="J5_rad", component="tilt"),
            "something over the reading of J5 that changes joint J4 (the tilt of its "
            "axis)",
        ),
    ],
)
def test_effects_have_names_for_people(made, text):
    assert candidate_label(made) == text


@pytest.mark.parametrize(
    ("numbers", "text"),
    [
        ((2.31e-5, 1.2e-6, "rad"), "23.1 ± 1.2 µrad"),
        ((-1.475e-5, 4e-7, "1/C"), "-14.75 ± 0.40 ppm/°C"),
        ((8.25e-6, 1.3e-7, "rad/(N m)"), "8.25 ± 0.13 µrad/(N m)"),
        ((4.5e-5, 1.7e-6, "mm/s"), "45.0 ± 1.7 nm/s"),
        ((0.0042, None, "mm"), "4.2 µm"),
        ((3.2e-9, None, "rad/s"), "3.2 nrad/s"),
        ((12.3456, 0.0, "ppm"), "12 ± 0 ppm"),
        ((0.0, None, "rad"), "0 rad"),
    ],
)
def test_numbers_have_units_and_as_many_digits_as_are_known(numbers, text):
    assert quantity(*numbers) == text


def test_the_size_of_cosine_and_sine_is_their_amplitude():
    estimates = {
        "cos_rad": Estimate(3e-5, 1e-6, "rad"),
        "sin_rad": Estimate(-4e-5, 2e-6, "rad"),
    }
    value, std, unit = term_size(estimates)
    assert unit == "rad"
    assert value == pytest.approx(5e-5)
    # d|a| = (c dc + s ds) / |a|
    assert std == pytest.approx(((0.6 * 1e-6) ** 2 + (0.8 * 2e-6) ** 2) ** 0.5)


def test_where_or_when_is_no_size():
    estimates = {
        "amplitude_mm": Estimate(0.004, 0.0002, "mm"),
        "phase_rad": Estimate(1.0, 0.1, "rad"),
    }
    assert term_size(estimates) == (0.004, 0.0002, "mm")
    assert term_size({}) is None


def test_the_size_of_a_curve_is_its_range():
    curve = {"values_rad": Estimate((0.0, 2e-5, -1e-5), (1e-6,) * 3, "rad")}
    value, _, _ = term_size(curve)
    assert value == pytest.approx(3e-5)
    term = replace(
        eccentric().terms[0],
        parameters=curve,
        candidate=candidate("empirical", "J3", covariate="time_s"),
    )
    assert term_size_text(term) == "30 µrad from lowest to highest"


def test_odds_and_probabilities_never_underflow():
    assert odds(0.0) == "1 to 1"
    assert odds(3.689) == "40 to 1"
    assert odds(2000.0) == "10^869 to 1"
    assert probability_of_log(-2.0) == "0.01"
    assert probability_of_log(-1234.5) == "10^-1234"


def test_the_first_sentence_names_the_effect_its_joint_and_its_size():
    first = WORDS.lines("verdict", eccentric())[0]
    assert first.startswith("Missing effect: encoder eccentricity, joint J3 (3")
    assert first.endswith(" µrad).")


def test_clean_says_so_and_names_no_effect():
    sentences = WORDS.lines("missing", clean())
    assert len(sentences) == 1
    assert sentences[0].startswith("Clean: ")


def test_rivals_and_aliases_are_separated():
    term = eccentric().terms[0]
    rivals = (
        Alternative(
            candidate("axis_runout", "J3", order=2, component="radial"),
            term.log_bayes_factor - 3.689,
            0.93,
            alias=False,
        ),
        Alternative(candidate("encoder_scale", "J3"), 1.0, 0.99999, alias=True),
    )
    excluded, alias = WORDS.lines("rivals", replace(term, alternatives=rivals))
    assert excluded == (
        "Cannot be excluded: radial runout twice a turn, joint J3 "
        "(odds 40 to 1 against it)."
    )
    assert "structural alias): encoder scale, joint J3." in alias


def test_statuses_have_their_own_words():
    diagnosis = eccentric()
    term = diagnosis.terms[0]
    tentative = replace(term, status="tentative", accepted=False)
    text = " ".join(WORDS.lines("missing", replace(diagnosis, terms=(tentative,))))
    assert "tentatively" in text
    assert "It is not in the adapted arm." in text
    unknown = replace(
        term,
        status="unknown",
        harmonic=3,
        candidate=candidate("empirical", "J3", covariate="J5_rad"),
    )
    text = " ".join(WORDS.lines("missing", replace(diagnosis, terms=(unknown,))))
    assert "no known effect explains it: something over the reading of J5" in text
    assert "repeats 3 times a turn" in text


def test_a_veto_is_reported():
    text = " ".join(summary_lines(replace(eccentric(), vetoed=True)))
    assert "state: bad" in text
    assert "nothing was added" in text


def test_the_gap_is_reported_with_its_part_or_without():
    diagnosis = eccentric()
    assert "% of what is achievable" in WORDS.held_out(diagnosis)
    near_noise = replace(diagnosis.gap.before, chi2=1.0)
    assert "cannot be told" in WORDS.held_out(
        replace(diagnosis, gap=replace(diagnosis.gap, before=near_noise))
    )


def test_an_experiment_is_proposed_where_there_is_one():
    diagnosis = eccentric()
    term = replace(diagnosis.terms[0], separate_by="hang a known mass at the wrist")
    text = WORDS.lines("verdict", replace(diagnosis, terms=(term,)))
    assert "To separate: hang a known mass at the wrist" in text


def test_what_is_bound_to_an_unknown_time_is_reported():
    assert any(
        "is not written to the arm file" in line for line in summary_lines(drifting())
    )


def test_times_that_are_an_order_are_called_so():
    diagnosis = drifting()
    order = replace(diagnosis, campaign=replace(diagnosis.campaign, time_is_order=True))
    text = "\n".join(summary_lines(order))
    assert "The campaign's times are the order of its poses" in text
    assert "start_utc" not in text
    assert dict(conditions(order.campaign)).keys() >= {"number of the pose"}


def test_a_move_of_the_base_names_that_of_the_artefacts():
    diagnosis = drifting()
    (line,) = (
        line for line in WORDS.lines("missing", diagnosis) if "moved against" in line
    )
    assert "all artefacts, together, moved against the base" in line
    campaign = replace(diagnosis.campaign, artefacts=diagnosis.campaign.artefacts[:1])
    text = " ".join(WORDS.lines("missing", replace(diagnosis, campaign=campaign)))
    assert f"that {campaign.artefacts[0].id} moved against the base" in text
    text = " ".join(WORDS.lines("missing", eccentric()))
    assert "moved against" not in text


def test_excluded_poses_are_named_by_their_lines():
    line = eccentric().campaign.poses.lines[100]
    assert f"(line {line})" in summary_lines(eccentric())[-1]


DETECTABLE = (
    *(
        Detectable(
            candidate=candidate("encoder_eccentricity", joint),
            key="cos_rad",
            minimum=Size(least_rad, "rad"),
            best=Size(5e-6, "rad"),
            probe_mm=0.002,
        )
        for joint, least_rad in (("J1", 7e-6), ("J2", 9e-6))
    ),
    Detectable(
        candidate=candidate("joint_compliance", "J1"),
        key="compliance_rad_nm",
        why="J1 is vertical: gravity does not twist it",
    ),
    Detectable(
        candidate=candidate("base_drift"),
        key="rate_mm_s",
        minimum=Size(1e-5, "mm/s"),
        best=Size(8e-6, "mm/s"),
        probe_mm=0.003,
    ),
)


def test_detectable_sizes_stand_in_a_table_of_joints():
    assert joint_rows(DETECTABLE, ["J1", "J2", "J3"]) == [
        ["encoder eccentricity [µrad]", "7", "9", ""],
        ["torsion under gravity [rad/(N m)]", "—", "", ""],
    ]


def test_what_cannot_be_seen_has_a_reason():
    lines = detectable_lines(DETECTABLE)
    assert len(lines) == 4
    assert lines[0].endswith("from 7 µrad on (2 µm at the probe)")
    assert lines[2].endswith(
        "cannot be seen: J1 is vertical: gravity does not twist it"
    )


def test_a_worst_pose_that_is_predicted_worse_is_said():
    diagnosis = eccentric()
    first, last = diagnosis.gap.before, diagnosis.gap.after
    assert "worst pose" not in " ".join(summary_lines(diagnosis))
    worse = replace(
        diagnosis.gap, after=replace(last, largest_mm=1.6 * first.largest_mm)
    )
    words = " ".join(summary_lines(replace(diagnosis, gap=worse)))
    assert "The worst pose kept aside is predicted worse with what was added" in words
    gap = diagnosis_json(diagnosis)["gap"]
    largest = {"before": first.largest_mm, "after": last.largest_mm}
    assert gap["held_out_largest_mm"] == largest


def test_a_curve_says_where_it_was_seen():
    diagnosis = eccentric()
    effect = effect_from_table(
        {
            "kind": "empirical",
            "joint": "J3",
            "covariate": "J3_rad",
            "knots": [-0.5, 0.0, 0.25, 1.0],
            "values_rad": [0.0, 1e-5, 2e-5, 0.0],
        }
    )
    term = diagnosis.terms[0]
    curve = replace(
        term,
        effect=effect,
        status="unknown",
        candidate=replace(term.candidate, kind="empirical", covariate="J3_rad"),
        parameters={},
    )
    words = " ".join(summary_lines(replace(diagnosis, terms=(curve,))))
    assert "seen where the reading of J3 is -28.65 to 57.3 degrees" in words
    (values,) = diagnosis_json(replace(diagnosis, terms=(curve,)))["terms"]
    assert values["seen"] == {"low": -0.5, "high": 1.0}
