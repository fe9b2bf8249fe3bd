"""What arms of one design have in common, as knowledge about one more of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from itertools import compress
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm, arm_digest
from traverse.strict_toml.problems import FileError, Problem
from traverse.strict_toml.reader import StrictModel, read_strict

# Part of the parameters, above which the whole arm left its family.
_MOST_CONTRADICTED = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Parameters of an arm as its family has them, independent of its measurements.

    Attributes:
        family: Name of the file.
        design: The arm that all of the family began with.
        n_arms: Of the family.
        names: Of the parameters.
        changes: Expected against the design, (n,).
        stds: Of an arm of the family, (n,).
        estimated: All parameters that the family's identifications estimated.
        contradicted: Parameters that the arm's own measurements contradict, and by
            how many standard deviations; these are not among the names any more. An
            arm that left its family in many has no names: it is no arm of it.
    """

    family: str
    design: Arm
    n_arms: int
    names: tuple[str, ...]
    changes: Floats
    stds: Floats
    estimated: tuple[str, ...]
    contradicted: tuple[tuple[str, float], ...] = ()

    def without(self, name: str, sigmas: float) -> "Prior":
        """Take a parameter out that the measurements contradict."""
        contradicted = (*self.contradicted, (name, sigmas))
        n_all = len(self.names) + len(self.contradicted)
        is_of_it = len(contradicted) <= _MOST_CONTRADICTED * n_all
        kept = np.array([is_of_it and known != name for known in self.names])
        return replace(
            self,
            names=tuple(compress(self.names, kept)),
            changes=self.changes[kept],
            stds=self.stds[kept],
            contradicted=contradicted,
        )


def family_json(prior: Prior | None) -> dict[str, Any]:
    """Put what a family said of an arm into plain values; nothing without one."""
    if prior is None:
        return {}
    contradicted = [{"name": name, "sigmas": w} for name, w in prior.contradicted]
    return {
        "family": {
            "file": prior.family,
            "arms": prior.n_arms,
            "parameters": list(prior.names),
            "contradicted": contradicted,
        }
    }


class FamilyParameter(StrictModel):
    """A parameter in a family's file.

    Attributes:
        mean, spread: Of the population.
        std: Of one more arm: the spread, with what is not known of both.
    """

    unit: str
    mean: float
    spread: Annotated[float, Field(ge=0.0)]
    std: Annotated[float, Field(gt=0.0)]


class FamilyFile(StrictModel):
    """What `traverse fleet family --out` writes.

    Attributes:
        design: Digest of the arm file that all began with.
        arms: How many.
        parameters: By name, all that the identifications estimated.
    """

    schema_: Literal["traverse/family/1"] = Field(alias="schema")
    design: str
    arms: Annotated[int, Field(ge=1)]
    parameters: dict[str, FamilyParameter]


def read_prior(path: Path, design: Arm, patterns: Sequence[str] = ()) -> Prior:
    """Read a family's file, of the parameters that fit a pattern; default all.

    Vectors of tools are no property of an arm and are left out.

    Raises:
        FileError: It is no such file, of another design, or a pattern fits nothing.
    """
    family = read_strict(path, FamilyFile)
    if family.design != arm_digest(design):
        message = (
            f"its arms were identified from another design ({family.design[:12]}) than "
            f"'{design.name}' ({arm_digest(design)[:12]}); give the arm file that all "
            "of the family began with"
        )
        raise FileError(path, [Problem("design", message)])
    known = [name for name in family.parameters if not name.startswith("tool.")]
    used = dict.fromkeys(known if not patterns else ())
    for pattern in patterns:
        fitting = [name for name in known if fnmatchcase(name, pattern)]
        if not fitting:
            message = f"'{pattern}' fits no parameter; there are {', '.join(known)}"
            raise FileError(path, [Problem("parameters", message)])
        used.update(dict.fromkeys(fitting))
    entries = [family.parameters[name] for name in used]
    return Prior(
        path.name,
        design,
        family.arms,
        tuple(used),
        np.array([entry.mean for entry in entries]),
        np.array([entry.std for entry in entries]),
        tuple(known),
    )
