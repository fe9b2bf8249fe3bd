"""Populations of parameters against drawn families, and the command."""

import json

import numpy as np
import pytest
from scipy.optimize import minimize

from tests.running import invoke
from traverse.lab.identification.family import (
    LEAST,
    family_values,
    population_of,
    read_family,
)

N_ARMS, N_PARAMETERS = 40, 12


def result(folder, values, stds, design="d" * 64, **more):
    folder.mkdir(parents=True)
    parameters = [
        {"name": f"J{n + 1}.link.v", "unit": "mm", "value": value, "std": std}
        for n, (value, std) in enumerate(zip(values, stds, strict=True))
    ]
    text = {
        "schema": "traverse/identification/1",
        "converged": True,
        "inputs": {"arm_digest": design, "hold": [], "free": []},
        "parameters": parameters,
        **more,
    }
    (folder / "identification.json").write_text(json.dumps(text))
    return folder


def drawn(rng, n=N_ARMS, spread=0.1, std=0.02):
    stds = std * rng.uniform(0.5, 2.0, n)
    return 3.0 + rng.normal(0.0, np.hypot(spread, stds)), stds


def restricted_likelihood(parameters, values, stds):
    """Written out, -2 log L up to a constant."""
    mean, spread = parameters
    variances = spread**2 + stds**2
    return (
        np.log(variances).sum()
        + np.log((1.0 / variances).sum())
        + ((values - mean) ** 2 / variances).sum()
    )


@pytest.mark.parametrize("spread", [0.0, 0.01, 0.1])
def test_mean_and_spread_are_where_the_likelihood_is_largest(spread):
    rng = np.random.default_rng(1)
    values, stds = drawn(rng, spread=spread)
    population = population_of(values, stds, 1e-12)
    best = minimize(
        restricted_likelihood,
        [values.mean(), values.std()],
        (values, stds),
        method="Nelder-Mead",
        options={"xatol": 1e-9, "fatol": 1e-12, "maxiter": 4000},
    )
    assert population.mean == pytest.approx(best.x[0], abs=1e-5)
    assert population.spread == pytest.approx(abs(best.x[1]), abs=1e-4)


def test_without_uncertainties_it_is_students_test():
    rng = np.random.default_rng(2)
    values = rng.normal(5.0, 2.0, 20)
    population = population_of(values, np.zeros(20), 1e-12)
    assert population.mean == pytest.approx(values.mean())
    assert population.spread == pytest.approx(values.std(ddof=1))
    without_fourth = np.delete(values, 3)
    expected = (values[3] - without_fourth.mean()) / (
        without_fourth.std(ddof=1) * np.sqrt(1 + 1 / 19)
    )
    assert population.spreads[3] == pytest.approx(expected)


def test_one_family_in_a_hundred_has_a_false_alarm():
    rng = np.random.default_rng(3)
    level = 0.01 / N_ARMS
    alarms = sum(population_of(*drawn(rng), level).strangers.any() for _ in range(75))
    # 0.75 expected; 5 and more have a chance of one in a thousand.
    assert alarms < 5


def test_strangers_do_not_hide_one_another():
    rng = np.random.default_rng(4)
    values, stds = drawn(rng)
    values[[3, 17, 30]] += [1.0, 1.1, 0.9]
    population = population_of(values, stds, 0.01 / N_ARMS)
    assert set(np.flatnonzero(population.strangers)) == {3, 17, 30}
    assert population.spread == pytest.approx(0.1, rel=0.4)


def folders(tmp_path, rng, n=N_ARMS):
    spreads = rng.uniform(0.02, 0.2, N_PARAMETERS)
    stds = 0.01 * rng.uniform(0.5, 2.0, (n, N_PARAMETERS))
    values = rng.normal(0.0, np.hypot(spreads, stds))
    values[5, 2] = 9.0 * spreads[2]
    return [
        result(tmp_path / f"arm-{row}", values[row].tolist(), stds[row].tolist())
        for row in range(n)
    ]


def run(*words, status=0):
    return invoke("fleet", "family", *words, status=status)


def test_the_command_names_who_leaves_the_family(tmp_path):
    arms = folders(tmp_path, np.random.default_rng(5))
    ran = run(*arms, status=1)
    assert "40 arms of the design dddddddddddd" in ran.output
    assert f"{arms[5]}: J3.link.v is +" in ran.output
    assert "spreads from its family" in ran.output
    values = json.loads(run(*arms, "--json", status=1).stdout)
    assert [(value["arm"], value["parameter"]) for value in values["alarms"]] == [
        (str(arms[5]), "J3.link.v")
    ]
    good = [path for path in arms if path.name != "arm-5"]
    assert "no arm leaves its family" in run(*good).output
    assert values["parameters"][2]["arms"] == N_ARMS - 1
    assert family_values(read_family(arms))["alarms"] == values["alarms"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": "x"}, "is no result of `traverse identify`: its schema is not"),
        ({"converged": False}, "the adjustment did not converge"),
        ({"parameters": [{"name": "a"}]}, "is no result of `traverse identify`"),
        ({"parameters": []}, "no parameter in common"),
        ({"inputs": {"arm_digest": "other"}}, "began with 2 designs"),
    ],
)
def test_what_is_no_family_is_refused(tmp_path, change, message):
    arms = folders(tmp_path, np.random.default_rng(6), n=LEAST)
    result(tmp_path / "odd", [0.0] * N_PARAMETERS, [0.1] * N_PARAMETERS, **change)
    ran = run(*arms, tmp_path / "odd", status=2)
    assert message in " ".join(ran.output.split())


def test_too_few_arms_are_no_family(tmp_path):
    arms = folders(tmp_path, np.random.default_rng(6), n=LEAST - 1)
    assert "a family has at least 8" in run(*arms, status=2).output
    run(tmp_path / "nowhere", *arms, status=2)
