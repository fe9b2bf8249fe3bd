"""Points that a campaign leaves out because of their flags, and the report on them."""

from collections import Counter
from collections.abc import Iterable

from traverse.cli.common.refusals import refuse
from traverse.daemon.conditions.table import CONDITIONS
from traverse.plurals import counted
from traverse.protocol.messages import (
    FLAG_MEANINGS,
    REMARKS,
    QualityFlag,
    flag_names,
)

ALLOWED = "surface_unknown,empirical"
UNNEEDED = frozenset(("geometry_unknown", "utc_uncertain", *flag_names(REMARKS.value)))
"""Flags of what a campaign does not use, as it takes angles and identifies the arm; and
remarks."""


def allowed_flags(option: str) -> frozenset[str]:
    flags = frozenset(flag.strip() for flag in option.split(",") if flag.strip())
    known = {str(flag.name).lower() for flag in FLAG_MEANINGS}
    if unknown := sorted(flags - known):
        refuse(
            f"--allow: no quality flag {', '.join(unknown)}; there are: "
            f"{', '.join(sorted(known))}"
        )
    return flags


def remedy_of(flag: str) -> str:
    bit = QualityFlag[flag.upper()]
    rows = [row.remedy for row in CONDITIONS if row.flags & bit]
    return rows[0] if rows else FLAG_MEANINGS[bit]


class FlaggedPoints:
    """Counts the points that are left out.

    Args:
        allowed: flags that a point may have.
    """

    def __init__(self, allowed: Iterable[str]) -> None:
        self._allowed = UNNEEDED | frozenset(allowed)
        self.n_points = 0
        self.by_flag: Counter[str] = Counter()

    def leaves_out(self, flags: Iterable[str]) -> list[str]:
        """Return those flags for which a point is left out, and count it."""
        flags = [flag for flag in flags if flag not in self._allowed]
        self.by_flag.update(flags)
        self.n_points += bool(flags)
        return flags

    def lines(self) -> list[str]:
        if not self.n_points:
            return []
        return [
            f"{counted(self.n_points, 'point', 'were')} left out because of "
            "flags; touch them again when that is put right, or see --allow:",
            *(
                f"  {flag}: {counted(n, 'point')}; {remedy_of(flag)}"
                for flag, n in self.by_flag.most_common()
            ),
        ]
