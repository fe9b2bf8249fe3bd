"""Accept, reject, neither; and the file of limits."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.lab.measurements import limits
from traverse.lab.acceptance.conformity import decision_of, worst
from traverse.lab.acceptance.limits import NO_LIMITS, LengthLimit, Limits
from traverse.strict_toml.problems import FileError
from traverse.strict_toml.reader import read_strict

# Limit 10 um, u = 2 um: the guard band of 1.65 u is 3.3 um wide.
CASES = [
    (0.0, "accept", "accept"),
    (0.0066, "accept", "accept"),
    (0.0068, "neither", "accept"),
    (-0.0068, "neither", "accept"),
    (0.0099, "neither", "accept"),
    (0.0101, "neither", "reject"),
    (0.0132, "neither", "reject"),
    (0.0134, "reject", "reject"),
    (-0.0134, "reject", "reject"),
]


@pytest.mark.parametrize(("error", "guarded", "simple"), CASES)
def test_by_hand(error, guarded, simple):
    assert decision_of(error, 0.010, 0.002, limits()).verdict == guarded
    plain = decision_of(error, 0.010, 0.002, limits(decision="simple"))
    assert (plain.verdict, plain.guard_mm) == (simple, 0.0)


def test_nothing_is_decided_without_an_uncertainty():
    decision = decision_of(0.0, 0.010, None, limits())
    assert (decision.verdict, decision.guard_mm) == ("undecided", None)
    simple = decision_of(0.0, 0.010, None, limits(decision="simple"))
    assert (simple.verdict, simple.guard_mm) == ("undecided", None)


@given(st.floats(-1, 1), st.floats(1e-6, 1), st.floats(0, 1))
def test_guard_bands_only_take_away(error, limit, standard):
    guarded = decision_of(error, limit, standard, limits()).verdict
    plain = decision_of(error, limit, standard, limits(decision="simple")).verdict
    assert guarded in (plain, "neither")
    assert plain != "neither"


def test_one_rejection_rejects():
    assert worst(["accept", "neither", "reject"]) == "reject"
    assert worst(["accept", "undecided", "neither"]) == "undecided"
    assert worst(["accept", "neither"]) == "neither"
    assert worst([]) == "accept"


def test_a_file_of_limits(tmp_path):
    file = tmp_path / "limits.toml"
    file.write_text(
        'schema = "traverse/acceptance-limits/1"\ndecision = "simple"\n'
        "[mpe]\np_size_mm = 0.012\n"
        "e_uni_mm = { constant_mm = 0.01, per_m_mm = 0.005 }\ne_bi_mm = 1\n"
    )
    limits = read_strict(file, Limits)
    assert limits.mpe.of("e_uni").at(2000.0) == pytest.approx(0.02)
    assert limits.mpe.of("e_uni") == LengthLimit(constant_mm=0.01, per_m_mm=0.005)
    assert limits.mpe.of("e_bi").at(5.0) == 1.0
    assert limits.mpe.of("p_size").constant_mm == 0.012
    assert limits.mpe.of("p_form") is None
    assert NO_LIMITS.guard_factor == 1.65


def test_everything_wrong_with_limits_is_said_at_once(tmp_path):
    file = tmp_path / "limits.toml"
    file.write_text(
        'schema = "traverse/acceptance-limits/1"\nguard = 2\n'
        '[mpe]\np_size_mm = -1.0\ne_uni_mm = "0.03"\nl_dia = 0.04\n'
    )
    with pytest.raises(FileError) as refused:
        read_strict(file, Limits)
    wheres = {problem.where for problem in refused.value.problems}
    assert {"guard", "mpe.p_size_mm", "mpe.e_uni_mm", "mpe.l_dia"} <= wheres
