"""The daemon that reports movements (6.3.2.7)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from traverse.arrays import Floats
from traverse.client.gateways.ippdme.grammar import (
    Argument,
    Command,
    IppError,
    Property,
)
from traverse.client.gateways.ippdme.machine import Machine, shown
from traverse.protocol.messages import Live

MIN_PERIOD_S = 0.1  # at most ten movements a second are reported


@dataclass(slots=True)
class MoveReport:
    """Reports poses after a time or a distance, whichever is first.

    Attributes:
        tag: of the command that requested it.
        is_due: the next pose is reported, however near.
    """

    tag: str
    period_s: float | None
    distance_mm: float | None
    names: Sequence[str]
    at_s: float = -np.inf
    place_mm: Floats | None = None
    is_due: bool = False
    in_doubt: bool = False

    def warn_of_period(self) -> None:
        """Lengthen a period that is too short.

        Raises:
            IppError: a warning: it was too short.
        """
        if self.period_s is not None and self.period_s < MIN_PERIOD_S:
            self.period_s = MIN_PERIOD_S
            raise IppError(504, f"Time is {MIN_PERIOD_S:g} s at least, which is used")

    def line(self, live: Live, machine: Machine) -> str:
        """Return the report of a pose, or nothing where none is due.

        Raises:
            IppError: poses are in doubt from now on.
        """
        was_in_doubt, self.in_doubt = self.in_doubt, True
        try:
            machine.require_good(live, "the pose")
            data = machine.values(self.names, live)
        except IppError:
            if was_in_doubt:
                return ""
            raise
        self.in_doubt = False
        place_mm, now_s = np.array(live.xyz_mm), machine.live_s
        if not self._is_wanted(place_mm, now_s):
            return ""
        self.at_s, self.place_mm, self.is_due = now_s, place_mm, False
        return f"{self.tag} # {data}"

    def _is_wanted(self, place_mm: Floats, now_s: float) -> bool:
        since_s = now_s - self.at_s
        far = self.distance_mm is not None and (
            self.place_mm is None
            or np.linalg.norm(place_mm - self.place_mm) > self.distance_mm
        )
        late = self.period_s is not None and since_s >= self.period_s
        return since_s >= MIN_PERIOD_S and bool(far or late or self.is_due)


def requested_report(command: Command, machine: Machine) -> MoveReport:
    """Read the arguments of `OnMoveReportE`.

    Raises:
        IppError: one of them is wrong, or neither time nor distance is given.
    """
    limits: dict[str, float] = {}
    report_args: list[Argument] = []
    for arg in command.args:
        if not isinstance(arg, Property) or arg.name not in ("Time", "Dis"):
            report_args.append(arg)
        elif len(arg.values) != 1 or arg.name in limits or arg.values[0] < 0.0:
            raise IppError(509, f"{shown(arg)}: expected one number above 0, once")
        else:
            limits[arg.name] = arg.values[0]
    if not limits:
        raise IppError(502, "Time or Dis is missing")
    names = machine.enumerated(report_args)
    return MoveReport(command.tag, limits.get("Time"), limits.get("Dis"), names)
