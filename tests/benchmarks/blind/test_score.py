"""The score of a diagnosis, on findings made by hand.

The table of the blind test, and the file of its runs.
"""

import numpy as np
import pytest

from benchmarks.blind.__main__ import PROGRAM
from benchmarks.blind.outcomes import FULL, QUICK, SCENARIOS
from benchmarks.blind.score import TrueTerm, deviations, pooled_gap, scored_terms
from benchmarks.blind.table import rows
from benchmarks.trials.lines import append
from traverse.kinematics.arm_file.arm import effect_from_table
from traverse.lab.outcomes.candidate import BankName, Candidate
from traverse.lab.outcomes.diagnosis import Alternative, Estimate, Term

J3_ECCENTRICITY = ("encoder_eccentricity", "J3", None, None, None)
J3_RUNOUT = ("axis_runout", "J3", 2, "radial", None)
J5_SCALE = ("encoder_scale", "J5", None, None, None)


def candidate(identity):
    kind, joint, order, component, artefact = identity
    return Candidate(
        bank=BankName.LIBRARY,
        kind=kind,
        joint=joint,
        order=order,
        component=component,
        covariate=None,
        artefact=artefact,
        at_s=None,
        parameters=("a",),
        scales=(1.0,),
        log_prior=0.0,
    )


def term(identity, status="named", alternatives=(), evidence=50.0, estimates=None):
    alternative_terms = tuple(
        Alternative(candidate(other), evidence - 2.0, 0.9, alias)
        for other, alias in alternatives
    )
    return Term(
        status=status,
        candidate=candidate(identity),
        effect=effect_from_table(
            {
                "kind": "encoder_eccentricity",
                "joint": "J3",
                "cos_rad": 1e-5,
                "sin_rad": 0.0,
            }
        ),
        parameters=estimates or {},
        log_bayes_factor=evidence,
        log10_p=-20.0,
        harmonic=None,
        alternatives=alternative_terms,
        separate_by="",
        accepted=True,
    )


def truth(identity, *aliases, sizes=None, in_library=True):
    names = frozenset({identity, *aliases})
    return TrueTerm(identity, sizes or {}, names, in_library)


def test_right_name_alone_is_exact_and_single():
    score = scored_terms((truth(J3_ECCENTRICITY),), (term(J3_ECCENTRICITY),), "named")
    assert score.exact
    assert score.right_joint
    assert score.in_set
    assert score.single
    assert score.all_exact
    assert not score.confident_wrong
    assert score.n_spurious == 0


def test_another_name_at_the_same_joint_is_wrong_but_near():
    score = scored_terms((truth(J3_ECCENTRICITY),), (term(J3_RUNOUT),), "named")
    assert not score.exact
    assert score.right_joint
    assert not score.in_set
    assert score.confident_wrong
    assert score.n_spurious == 1


def test_an_alias_counts_as_the_name():
    hidden = truth(J3_ECCENTRICITY, J3_RUNOUT)
    score = scored_terms((hidden,), (term(J3_RUNOUT),), "named")
    assert score.exact
    assert score.all_exact
    assert not score.confident_wrong


def test_truth_among_the_alternatives_is_in_the_set():
    named = term(J3_RUNOUT, "tentative", [(J3_ECCENTRICITY, False)])
    score = scored_terms((truth(J3_ECCENTRICITY),), (named,), "tentative")
    assert score.in_set
    assert score.set_size == 2
    assert not score.single
    assert not score.confident_wrong


def test_aliases_do_not_make_a_set_larger():
    named = term(J3_ECCENTRICITY, alternatives=[(J3_RUNOUT, True)])
    score = scored_terms((truth(J3_ECCENTRICITY),), (named,), "named")
    assert score.set_size == 1
    assert score.single


def test_clean_says_nothing_was_found():
    score = scored_terms((truth(J3_ECCENTRICITY),), (), "clean")
    assert not score.detected
    assert not score.exact
    assert not score.in_set
    assert score.n_terms == 0
    assert not score.all_exact


def test_clean_is_right_where_nothing_is_hidden():
    assert scored_terms((), (), "clean").all_exact


def test_a_name_for_nothing_is_spurious_and_wrong():
    score = scored_terms((), (term(J5_SCALE),), "named")
    assert score.detected
    assert score.confident_wrong
    assert score.n_spurious == 1


def test_a_pair_needs_both_names_and_nothing_else():
    hidden = (truth(J3_ECCENTRICITY), truth(J5_SCALE))
    pair = (term(J5_SCALE), term(J3_ECCENTRICITY))
    assert scored_terms(hidden, pair, "named").all_exact
    single = scored_terms(hidden, pair[:1], "named")
    assert single.n_matched == 1
    assert not single.all_exact
    three = scored_terms(hidden, (*pair, term(J3_RUNOUT)), "named")
    assert three.n_matched == 2
    assert three.n_spurious == 1
    assert not three.all_exact


def test_one_term_does_not_match_two_truths():
    hidden = (truth(J3_ECCENTRICITY, J3_RUNOUT), truth(J3_RUNOUT, J3_ECCENTRICITY))
    assert scored_terms(hidden, (term(J3_RUNOUT),), "named").n_matched == 1


def test_the_strongest_term_is_the_one_that_is_judged():
    terms = (term(J5_SCALE, evidence=8.0), term(J3_ECCENTRICITY, evidence=80.0))
    assert scored_terms((truth(J3_ECCENTRICITY),), terms, "named").exact


def test_an_unknown_at_the_right_joint_is_the_answer_outside_the_library():
    hidden = truth(("bump", "J3", None, None, None), in_library=False)
    named = term(("empirical", "J3", None, None, None), "unknown")
    score = scored_terms((hidden,), (named,), "unknown")
    assert score.unknown_right_joint
    assert score.right_joint
    assert not score.exact
    assert not score.single
    assert not score.confident_wrong


def test_deviations_are_in_stated_standard_deviations():
    estimates = {
        "cos_rad": Estimate(3.0e-5, 1e-6, "rad"),
        "sin_rad": Estimate(-1.0e-5, 2e-6, "rad"),
    }
    named = term(J3_ECCENTRICITY, estimates=estimates)
    hidden = truth(J3_ECCENTRICITY, sizes={"cos_rad": 2.9e-5, "sin_rad": -1.6e-5})
    assert deviations(hidden, named) == pytest.approx((1.0, 3.0))
    score = scored_terms((hidden,), (named,), "named")
    assert score.deviations == pytest.approx((1.0, 3.0))


def test_no_parameters_are_compared_under_another_name():
    estimates = {"cos_rad": Estimate(3.0e-5, 1e-6, "rad")}
    hidden = truth(J3_ECCENTRICITY, J3_RUNOUT, sizes={"cos_rad": 0.0})
    named = term(J3_RUNOUT, estimates=estimates)
    assert scored_terms((hidden,), (named,), "named").deviations == ()


def test_a_phase_is_compared_around_the_circle():
    named = term(
        ("probe_lobing", None, None, None, None),
        estimates={"phase_rad": Estimate(3.1, 0.1, "rad")},
    )
    hidden = truth(("probe_lobing", None, None, None, None), sizes={"phase_rad": -3.1})
    assert deviations(hidden, named) == pytest.approx(((6.2 - 2.0 * np.pi) / 0.1,))


def test_components_that_are_no_freedoms_are_left_out():
    estimates = {"cos_mm": Estimate((0.01, 0.02, 3e-5), (1e-3, 1e-3, 2e-6), "mm")}
    named = term(J3_RUNOUT, estimates=estimates)
    hidden = truth(J3_RUNOUT, sizes={"cos_mm": (0.01, 0.019, 0.0)})
    assert deviations(hidden, named) == pytest.approx((0.0, 1.0))


def test_gap_is_pooled_and_not_averaged():
    # 9 of 10 and 0 of 0.1 closed: 9 / 10.1 together.
    assert pooled_gap([(11.0, 2.0, 1.0), (1.1, 1.1, 1.0)]) == pytest.approx(9.0 / 10.1)


def test_gap_without_a_gap_is_none():
    assert pooled_gap([(1.0, 1.0, 1.0)]) is None
    assert pooled_gap([]) is None


GOOD = {
    "detected": True,
    "exact": True,
    "right_joint": True,
    "in_set": True,
    "single": True,
    "unknown": False,
    "confident_wrong": False,
    "all_exact": True,
    "deviations": [0.5, -1.0, 2.5],
}
RIVAL = {"detected": True, "exact": False, "all_exact": False}
BASELINES = ("overall test", "raw correlation", "forward BIC", "sparse regression")


def line(scenario, seed, gap=None, **changes):
    return {
        "scenario": scenario,
        "seed": seed,
        "error": None,
        "hidden": [{"identity": ["backlash", "J1", None, None, None]}],
        "score": {**GOOD, **changes},
        "gap": gap,
        "seconds": 1.0,
        "rivals": dict.fromkeys(BASELINES, RIVAL),
    }


def table(lines):
    return {row.label: row for row in rows(lines)}


def test_a_rate_holds_as_long_as_its_interval_reaches_the_figure():
    # 17 of 20: 62.1 to 96.8 % by Clopper and Pearson, as their tables have it.
    lines = [line("one at 6", seed, detected=seed >= 3) for seed in range(20)]
    row = table(lines)["detection at 6"]
    assert row.share == pytest.approx(0.85)
    assert row.interval == pytest.approx((0.621, 0.968), abs=5e-4)
    assert row.holds
    assert not table(lines * 20)["detection at 6"].holds


def test_false_alarms_are_bounded_from_above():
    lines = [line("clean, noise known", seed, detected=seed < 1) for seed in range(100)]
    assert table(lines)["false alarms, noise known"].holds
    many = [line("clean, noise known", s, detected=s < 8) for s in range(100)]
    assert not table(many)["false alarms, noise known"].holds


def test_rivals_stand_beside_where_they_have_an_answer():
    rows = table([line("one at 6", 0)])
    assert rows["detection at 6"].baselines == (1.0,) * 4
    assert rows["exact name at 6"].baselines == (None, 0.0, 0.0, 0.0)
    assert rows["right joint at 6"].baselines == (None,) * 4


def test_a_run_that_broke_counts_as_not_found():
    broken = {"scenario": "one at 6", "seed": 1, "error": "ValueError: no"}
    rows = table([line("one at 6", 0), broken])
    assert rows["detection at 6"].share == pytest.approx(0.5)
    assert rows["runs that broke"].share == pytest.approx(0.5)
    assert not rows["runs that broke"].holds


def test_blunders_are_compared_seed_by_seed():
    plain = [line("one at 8", seed, exact=seed != 0) for seed in range(10)]
    # One that was wrong anyway, and one that blunders spoil.
    spoilt = [line("one at 8, 5% blunders", seed, exact=seed > 1) for seed in range(10)]
    row = table(plain + spoilt)["exact name at 8 lost by 5% blunders"]
    assert row.share == pytest.approx(0.1)
    assert row.n == 10


def test_gaps_are_pooled():
    gaps = [(11.0, 2.0, 1.0), (1.1, 1.1, 1.0), (2.0, 1.0, 1.0)]
    lines = [line("one at 10", seed, gap=gap) for seed, gap in enumerate(gaps)]
    row = table(lines)["gap closed at 10, pooled against the oracle"]
    assert row.share == pytest.approx(10.0 / 11.1)


def test_numbers_of_parameters_are_counted_one_by_one():
    row = table([line("one at 6", 0), line("two at 6", 0)])[
        "parameters within two sigma"
    ]
    assert row.n == 6
    assert row.share == pytest.approx(4.0 / 6.0)


def test_the_quick_test_is_of_two_hundred_runs_in_all_scenarios():
    assert sum(QUICK.values()) == 200
    assert set(QUICK) == set(FULL) == set(SCENARIOS)
    assert all(FULL[name] > QUICK[name] for name in QUICK)


def test_the_table_is_printed_without_making_runs(tmp_path, capsys):
    path = tmp_path / "runs.jsonl"
    append(path, [{**line("one at 6", 0), "code": "", "seconds_in_all": 1.0}])
    options = ["--scenarios", "one at 6", "--minutes", "0", "--any-code"]
    status = PROGRAM.main(["--out", str(path), *options])
    printed = capsys.readouterr().out
    assert "| detection at 6 | >= 95% | 1 |" in printed
    assert status == 0
