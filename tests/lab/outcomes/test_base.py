"""A result is good only where every condition of its table is established."""

import json

import pytest

from traverse.lab.outcomes.base import (
    Condition,
    Established,
    Reason,
    Shortfall,
    State,
    judge,
    worst,
)
from traverse.lab.report.quantities import plain_values

Numbers = dict[str, float]


def below(limit_mm: float, state: State) -> Condition[Numbers]:
    """A condition that the error is below a limit."""

    def check(numbers: Numbers) -> Established | list[Shortfall]:
        values = {"error_mm": numbers["error_mm"], "limit_mm": limit_mm}
        if numbers["error_mm"] < limit_mm:
            return Established(values)
        return [Shortfall(f"More than {limit_mm} mm.", "Measure again.", values, state)]

    code = f"below_{limit_mm:g}_mm"
    return Condition(code, f"the error is below {limit_mm} mm", check)


TABLE = (below(0.1, State.DOUBT), below(1.0, State.BAD))


@pytest.mark.parametrize(
    ("error_mm", "state", "codes"),
    [
        (0.05, State.GOOD, ()),
        (0.5, State.DOUBT, ("below_0.1_mm",)),
        (5.0, State.BAD, ("below_0.1_mm", "below_1_mm")),
        (float("nan"), State.BAD, ("below_0.1_mm", "below_1_mm")),
    ],
)
def test_state_is_that_of_the_worst_reason(
    error_mm: float, state: State, codes: tuple[str, ...]
) -> None:
    outcome = judge(TABLE, {"error_mm": error_mm})
    assert outcome.state is state
    assert outcome.codes == codes
    assert len(outcome.established) == len(TABLE) - len(codes)


def test_a_check_that_finds_nothing_establishes_nothing() -> None:
    silent = Condition[Numbers]("silent", "somebody looked", lambda _: [])
    outcome = judge((silent,), {})
    assert outcome.state is State.DOUBT
    assert outcome.reasons == (
        Reason(
            "silent",
            State.DOUBT,
            "It is not established that somebody looked.",
            "",
            {},
        ),
    )


def test_an_empty_table_is_no_all_clear() -> None:
    assert judge((), {}).state is State.DOUBT


def test_the_worst_reason_is_printed_first() -> None:
    outcome = judge(TABLE, {"error_mm": 2.0})
    assert outcome.sentences == [
        "More than 1.0 mm. Measure again.",
        "More than 0.1 mm. Measure again.",
    ]


def test_json_has_state_reasons_and_what_is_established() -> None:
    values = plain_values(judge(TABLE, {"error_mm": 0.5}))
    assert json.loads(json.dumps(values)) == {
        "state": "doubt",
        "reasons": [
            {
                "code": "below_0.1_mm",
                "state": "doubt",
                "text": "More than 0.1 mm.",
                "remedy": "Measure again.",
                "values": {"error_mm": 0.5, "limit_mm": 0.1},
            }
        ],
        "established": {"below_1_mm": {"error_mm": 0.5, "limit_mm": 1.0}},
    }


def test_worst_of_states() -> None:
    assert worst([]) is State.GOOD
    assert worst([State.GOOD, State.BAD, State.DOUBT]) is State.BAD
