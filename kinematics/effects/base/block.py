"""A block of samples with all inputs of effects.

Absent inputs are None, unknown samples NaN; an effect that needs one is refused by
name. The one exception is a law's own: an unknown contact force counts as 1 N.
"""

from dataclasses import dataclass, fields
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from traverse.arrays import Floats, Integers
from traverse.plurals import counted


class Covariate(StrEnum):
    """A quantity that may accompany the readings; the value is the plain word."""

    TEMPERATURE = "temperature"
    SPEED = "speed"
    APPROACH = "direction of approach"
    UTC = "time in UTC"
    CAMPAIGN_TIME = "time since the campaign's start"
    FORCE = "contact force"


@dataclass(frozen=True, slots=True)
class Need:
    """A covariate that every sample must have.

    Attributes:
        joint: counted from 0; None: of the arm as a whole.
    """

    covariate: Covariate
    joint: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Samples of an arm, one a row.

    Attributes:
        angles_rad: Readings alpha, (n_samples, n_joints).
        speeds_rad_s: d(alpha)/dt, (n_samples, n_joints).
        approaches: Sense of the last motion, -1, 0, +1, (n_samples, n_joints).
        temperature_c: Of the arm, (n_samples,).
        joint_temperatures_c: Of each joint and its element, (n_samples, n_joints);
            where NaN, the arm's own counts.
        utc_ns: Since 1970, (n_samples,) int64.
        campaign_s: Since the start of a campaign, (n_samples,).
        directions: Unit vectors from the ball towards the touched material, NaN
            where unknown, (n_samples, 3).
        force_n: Of the contact, NaN where unknown, (n_samples,).
        gravity_m_s2: Override of the arm's own (a tilted base), (3,).
    """

    angles_rad: Floats
    speeds_rad_s: Floats | None = None
    approaches: Floats | None = None
    temperature_c: Floats | None = None
    joint_temperatures_c: Floats | None = None
    utc_ns: Integers | None = None
    campaign_s: Floats | None = None
    directions: Floats | None = None
    force_n: Floats | None = None
    gravity_m_s2: Floats | None = None

    def __post_init__(self) -> None:
        shape = self.angles_rad.shape
        if len(shape) != 2:
            raise ValueError(
                f"block: angles_rad has shape {shape}, expected (n_samples, n_joints)"
            )
        shape_of = {"directions": (shape[0], 3), "gravity_m_s2": (3,)}
        for name in _COLUMN_NAMES:
            column = getattr(self, name)
            if column is None:
                continue
            expected = shape if name in _OF_JOINTS else shape_of.get(name, shape[:1])
            if column.shape != expected:
                raise ValueError(
                    f"block: {name} has shape {column.shape}, expected {expected} "
                    f"beside angles_rad of shape {shape}"
                )

    def __len__(self) -> int:
        return len(self.angles_rad)

    @property
    def n_joints(self) -> int:
        return int(self.angles_rad.shape[1])

    def part(self, rows: slice | Integers) -> "Block":
        columns: dict[str, Any] = {}
        for field in fields(self):
            column = getattr(self, field.name)
            is_shared = column is None or field.name == "gravity_m_s2"
            columns[field.name] = column if is_shared else column[rows]
        return Block(**columns)

    def rows(self, column: str, joints: slice) -> Floats:
        """Return a column of some joints as contiguous rows, (n_chosen, n_samples).

        Contiguous, because strided numbers may take another path through sine and
        cosine, and a sample's bits would depend on its neighbours.
        """
        return np.ascontiguousarray(_known(self, column)[:, joints].T)

    def row(self, column: str) -> Floats:
        """Return a column of the whole arm, (n_samples,)."""
        return np.ascontiguousarray(_known(self, column))

    def temperatures_c(self, joints: slice) -> Floats:
        """Return temperatures of joints, else of the arm, (n_chosen, n_samples)."""
        if self.joint_temperatures_c is None:
            arm_c = self.row("temperature_c")
            return np.broadcast_to(
                arm_c, (len(range(self.n_joints)[joints]), len(arm_c))
            )
        joints_c = self.rows("joint_temperatures_c", joints)
        if self.temperature_c is None:
            return joints_c
        return np.where(np.isnan(joints_c), self.temperature_c, joints_c)

    def is_known(self, covariate: Covariate) -> bool:
        """Return whether a quantity is known for every sample and joint."""
        column: NDArray[Any] | None = getattr(self, COLUMNS[covariate])
        if covariate is Covariate.TEMPERATURE and self.joint_temperatures_c is not None:
            return False  # one may replace the other: see `lack`
        return column is not None and bool(np.isfinite(column).all())

    def lack(self, need: Need) -> str | None:
        """Return the missing part of a need, or None if it is complete."""
        column = self._column(need)
        if column is None:
            return f"the block has no {need.covariate.value}"
        unknown = ~np.isfinite(column)
        if not unknown.any():
            return None
        return (
            f"{need.covariate.value} is unknown in {np.count_nonzero(unknown)} of "
            f"{counted(len(self), 'sample')}, the first is number "
            f"{int(np.argmax(unknown))}"
        )

    def _column(self, need: Need) -> NDArray[Any] | None:
        """Return the quantity of a need, (n_samples,)."""
        rows = slice(None) if need.joint is None else slice(need.joint, need.joint + 1)
        if need.covariate is Covariate.TEMPERATURE:
            if need.joint is None or self.joint_temperatures_c is None:
                return self.temperature_c
            temperature_c: NDArray[Any] = self.temperatures_c(rows)[0]
            return temperature_c
        name = COLUMNS[need.covariate]
        column: NDArray[Any] | None = getattr(self, name)
        if column is None or need.joint is None:
            return column
        of_joint: NDArray[Any] = column[:, need.joint]
        return of_joint


# Asked for once: a daemon makes a block for every point.
_COLUMN_NAMES = tuple(field.name for field in fields(Block))[1:]
_OF_JOINTS = frozenset(("speeds_rad_s", "approaches", "joint_temperatures_c"))

COLUMNS = {
    Covariate.TEMPERATURE: "temperature_c",
    Covariate.SPEED: "speeds_rad_s",
    Covariate.APPROACH: "approaches",
    Covariate.UTC: "utc_ns",
    Covariate.CAMPAIGN_TIME: "campaign_s",
    Covariate.FORCE: "force_n",
}


def _known(block: Block, name: str) -> Floats:
    column: Floats | None = getattr(block, name)
    if column is None:
        raise ValueError(f"block: {name} is absent, expected one value a sample")
    return column
