"""What arms of one type have in common: parameters of a population, and who leaves it.

Of n arms of one design, parameter x_i was identified with standard uncertainty s_i. In
a normal population with mean m and spread t

    x_i ~ N(m, t^2 + s_i^2).

m and t are those of largest likelihood, of the arms that do not leave the population:
arms are left out one after another, the farthest first, as long as the test below finds
one. It compares an arm with the others alone,

    T_i = (x_i - m_(i)) / sqrt(t_(i)^2 (1 + 1/(n - 1)) + s_i^2),

Student's t with n - 2 degrees of freedom where s_i is small beside t. The level is
divided by the number of arms and parameters (Bonferroni): all families without a
stranger together give one alarm in a hundred.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from scipy import special

from traverse.arrays import Booleans, Floats
from traverse.lab.report.templates import Words
from traverse.strict_toml.files import json_of
from traverse.strict_toml.problems import FileError
from traverse.strict_toml.writing import write_atomically

WORDS = Words("identification/family.jinja")
SCHEMA = "traverse/family/1"
RESULT = "traverse/identification/1"
LEVEL = 0.01
LEAST = 8
"""Arms; fewer say little of a spread."""
_MOST_STRANGERS = 0.25
_STEPS = 200


@dataclass(frozen=True, slots=True, eq=False)
class FamilyResults:
    """Identified parameters of n arms.

    Attributes:
        names: the folders as given, (n,).
        parameters: names of the p parameters that all have.
        units: of these.
        values: (n, p).
        stds: (n, p).
        design: digest of the arm file that all began with.
    """

    names: tuple[str, ...]
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    values: Floats
    stds: Floats
    design: str


@dataclass(frozen=True, slots=True, eq=False)
class Population:
    """One parameter of a family.

    Attributes:
        mean, spread: of the population, in its unit.
        std: of one more arm: the spread, with what is not known of it and of the mean.
        spreads: how far each arm is from the mean of the others, in spreads of what is
            expected of it, (n,).
        p_values: of that or more by chance, of each arm, (n,).
        strangers: who left the population, (n,).
    """

    mean: float
    spread: float
    std: float
    spreads: Floats
    p_values: Floats
    strangers: Booleans


def read_family(paths: Sequence[Path]) -> FamilyResults:
    """Read `identification.json` of folders.

    Raises:
        FileError: One is no such result, did not converge, or is of another design.
        ValueError: They are too few, or have no parameter in common.
    """
    if len(paths) < LEAST:
        raise ValueError(f"{len(paths)} arms; a family has at least {LEAST}")
    results = [_read(path) for path in paths]
    designs = {values["inputs"]["arm_digest"] for values in results}
    if len(designs) > 1:
        raise ValueError(
            f"the arms began with {len(designs)} designs (arm_digest in inputs); "
            "identify all with the same arm file"
        )
    tables = [
        {parameter["name"]: parameter for parameter in values["parameters"]}
        for values in results
    ]
    common = [name for name in tables[0] if all(name in table for table in tables)]
    if not common:
        raise ValueError("the results have no parameter in common")
    values, stds = (
        np.array([[table[name][key] for name in common] for table in tables], float)
        for key in ("value", "std")
    )
    if not (np.isfinite(values).all() and np.all(stds >= 0.0)):
        raise ValueError("a value or a standard deviation is not finite")
    return FamilyResults(
        tuple(map(str, paths)),
        tuple(common),
        tuple(tables[0][name]["unit"] for name in common),
        values,
        stds,
        designs.pop(),
    )


def _read(path: Path) -> dict[str, Any]:
    file = path / "identification.json" if path.is_dir() else path
    try:
        values = json_of(file)
        if not isinstance(values, dict) or values.get("schema") != RESULT:
            raise ValueError(f"its schema is not {RESULT}")
        if values["converged"] is not True:
            raise ValueError("the adjustment did not converge")
        values["inputs"]["arm_digest"]
        for parameter in values["parameters"]:
            (
                float(parameter["value"]),
                float(parameter["std"]),
                parameter["name"],
                parameter["unit"],
            )
    except OSError as error:
        reason = error.strerror or str(error)
        raise FileError(file, reason) from error
    except (ValueError, KeyError, TypeError) as error:
        message = f"is no result of `traverse identify`: {error}"
        raise FileError(file, message) from error
    return values


def population_of(values: Floats, stds: Floats, level: float) -> Population:
    """Fit one parameter's population, and test every arm against the others.

    Args:
        values: (n,).
        stds: (n,).
        level: of the test of one arm.
    """
    n = len(values)
    inside = np.ones(n, dtype=np.bool_)
    for _ in range(int(_MOST_STRANGERS * n)):
        statistics, p_values = _against_others(values, stds, inside)
        suspects = np.where(inside, np.abs(statistics), -1.0)
        worst = int(np.argmax(suspects))
        if not p_values[worst] < level:
            break
        inside[worst] = False
    statistics, p_values = _against_others(values, stds, inside)
    fitted = _fitted(values[inside], stds[inside])
    return Population(*fitted, statistics, p_values, p_values < level)


def _against_others(
    values: Floats, stds: Floats, inside: Booleans
) -> tuple[Floats, Floats]:
    """Return T and its p-value of every arm, against the arms inside without it."""
    statistics, p_values = np.zeros(len(values)), np.ones(len(values))
    for row in range(len(values)):
        further = inside.copy()
        further[row] = False
        n = int(np.count_nonzero(further))
        mean, spread, _ = _fitted(values[further], stds[further])
        expected = np.sqrt(spread**2 * (1.0 + 1.0 / n) + stds[row] ** 2)
        away = values[row] - mean
        if expected > 0.0:
            statistics[row] = away / expected
        elif away:
            statistics[row] = np.copysign(np.inf, away)
        p_values[row] = 2.0 * special.stdtr(n - 1, -abs(statistics[row]))
    return statistics, p_values


def _fitted(values: Floats, stds: Floats) -> tuple[float, float, float]:
    """Fit mean and spread: restricted likelihood by Fisher's steps (Harville 1977).

    Without uncertainties these are the mean and the standard deviation with n - 1. The
    third is the standard deviation of one more, t^2 + u(t^2) + u^2(m) being its
    variance: a family whose spread drowns in the uncertainties knows little.
    """
    variance = max(float(np.var(values, ddof=1)) - float(np.mean(stds**2)), 0.0)
    mean = float(values.mean())
    for _ in range(_STEPS):
        weights = 1.0 / np.maximum(variance + stds**2, 1e-300)
        total = weights.sum()
        mean = float(weights @ values / total)
        projected = weights * (values - mean)
        trace = total - (weights**2).sum() / total
        information = (
            (weights**2).sum()
            - 2.0 * (weights**3).sum() / total
            + ((weights**2).sum() / total) ** 2
        )
        step = (float(projected @ projected) - trace) / information
        before, variance = variance, max(variance + step, 0.0)
        if abs(variance - before) <= 1e-10 * (variance + before):
            break
    of_one_more = variance + np.sqrt(2.0 / information) + 1.0 / total
    return mean, float(np.sqrt(variance)), float(np.sqrt(of_one_more))


def family_values(family: FamilyResults) -> dict[str, Any]:
    """Judge all parameters of all arms; as plain values."""
    n_arms, n_parameters = family.values.shape
    level = LEVEL / (n_arms * n_parameters)
    parameters: list[dict[str, Any]] = []
    alarms: list[dict[str, Any]] = []
    for column, name in enumerate(family.parameters):
        population = population_of(
            family.values[:, column], family.stds[:, column], level
        )
        parameters.append(
            {
                "name": name,
                "unit": family.units[column],
                "mean": population.mean,
                "spread": population.spread,
                "std": population.std,
                "median_std": float(np.median(family.stds[:, column])),
                "arms": n_arms - int(np.count_nonzero(population.strangers)),
            }
        )
        alarms += [
            {
                "arm": family.names[row],
                "parameter": name,
                "unit": family.units[column],
                "value": float(family.values[row, column]),
                "spreads": float(population.spreads[row]),
                "p_value": float(population.p_values[row]),
            }
            for row in np.flatnonzero(population.strangers)
        ]
    alarms.sort(key=itemgetter("p_value"))
    return {
        "schema": SCHEMA,
        "design": family.design,
        "arms": list(family.names),
        "level": LEVEL,
        "parameters": parameters,
        "alarms": alarms,
    }


def family_lines(values: Mapping[str, Any]) -> list[str]:
    """Say it in lines: a parameter a line, then who leaves the family."""
    return WORDS.lines("family", values)


def write_family(values: Mapping[str, Any], path: Path) -> None:
    """Write what `identify --family` and `diagnose --family` read.

    Raises:
        OSError: It cannot be written.
    """
    table = {
        "schema": SCHEMA,
        "design": values["design"],
        "arms": len(values["arms"]),
        "parameters": {
            parameter["name"]: {
                key: parameter[key] for key in ("unit", "mean", "spread", "std")
            }
            for parameter in values["parameters"]
        },
    }
    write_atomically(path, tomlkit.dumps(table))
