"""Plan of a world, drawn from its seed."""

from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.honesty.families import FAMILIES, Family

FAULTLESS_SHARE = 0.25
ANSWER_S = 4.0  # that the operator waits
EDGE_S = 7.0  # faults begin so long after the start, and end so long before the end


@dataclass(frozen=True, slots=True)
class PlannedFault:
    """A planned fault.

    Attributes:
        lasts_s: duration; 0 for an instant.
        size: by kind: seconds, counts, or a share.
        device: number of the device concerned.
    """

    kind: str
    at_s: float
    lasts_s: float = 0.0
    size: float = 0.0
    device: int = 0


@dataclass(frozen=True, slots=True)
class Action:
    """An action of the operator at a true time."""

    at_s: float
    kind: str
    size: float = 0.0


@dataclass(frozen=True, slots=True)
class Plan:
    """A world before it begins.

    Attributes:
        drifts_ppm_s: change of that in a second.
        delays_s: least, usual and bunch of each device's cable.
        pace: how the arm is led, see `PACES`.
        in_scan: its faults fall into a scan.
        is_identified: the arm file has a covariance.
        is_confirmed: the operator confirms the references in the beginning.
    """

    seed: int
    family: str
    duration_s: float
    rates_ppm: tuple[float, ...]
    drifts_ppm_s: tuple[float, ...]
    delays_s: tuple[tuple[float, float, float], ...]
    pace: str
    is_identified: bool = True
    is_confirmed: bool = True
    is_incremental: bool = False
    in_scan: bool = False
    faults: tuple[PlannedFault, ...] = ()
    actions: tuple[Action, ...] = field(default=(), repr=False)

    @property
    def homes_s(self) -> tuple[float, ...]:
        """When the arm is put into its home posture, if necessary."""
        if not self.is_incremental:
            return ()
        ends_s = [f.at_s + f.lasts_s + 3.0 for f in self.faults if f.kind in OF_POWER]
        return (0.0, *sorted(ends_s))

    @property
    def restarts(self) -> list[tuple[float, float, str]]:
        """When the daemon ends and begins again, and a board's change meanwhile."""
        pauses: list[tuple[float, float, str]] = []
        for fault in sorted(self.faults, key=lambda fault: fault.at_s):
            if fault.kind in ("daemon_restart", "computer_restart"):
                begin_s = max(fault.at_s, pauses[-1][1] + 1.0 if pauses else 0.0)
                lasts_s = max(fault.lasts_s, 0.5)
                kind = ("", "board_restart", "exchange")[int(fault.size)]
                pauses.append((begin_s, begin_s + lasts_s, kind))
        return pauses

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of its faults, each once; ("none",) without any."""
        before = "scan+" if self.in_scan else ""
        return tuple(sorted({before + f.kind for f in self.faults})) or ("none",)


FAULT_KINDS = (
    "clock_rate",  # of a resonator, up to 2 %
    "clock_drift",
    "device_stall",  # its timer stands, and with it the device
    "timer_loss",  # its timer loses time, the device goes on
    "host_freeze",  # the computer is suspended: its clock stands, too
    "process_stall",  # the daemon gets no time
    "loop_stall",  # its event loop alone
    "delays",  # of the cables, up to 50 ms
    "lost",
    "corrupted",
    "cut",
    "garbage",
    "board_restart",
    "unplug",
    "daemon_restart",
    "computer_restart",
    "swap",
    "exchange",
    "utc_step",
    "utc_1970",
    "utc_ahead",
    "incremental",  # moved while it had no power
    "unidentified",
    "unconfirmed",
)
FROZEN_KINDS = (
    "frozen_channel",  # one count stays what it is while its joint moves
    "frozen_device",  # all counts of a device
)
LONE_KINDS = (
    *FROZEN_KINDS,  # a reading that is missing meanwhile begins the observation anew
    "host_slew",  # a program brings UTC back: all of the host's clocks run 500 ppm off
    "bus_off",  # and recovery
    "preset",  # a count jumps, and goes on from there: set anew, or reset by an index
    "unread",  # a board's read of an encoder fails now and then: its last count again
    "clock_pair",  # devices' clocks are wrong by as much, one fast and one slow
)
"""Drawn without others."""
LONE_SHARE, MOST_LONE_S, SLEW_PPM = 0.08, 6.0, 500.0
SCAN_KINDS = (
    "usb_reset",  # ports of one device, or of all, are away for a moment
    "board_restart",
    "swap",
    "utc_step",  # to a wrong time
    "utc_set",  # from a wrong time to the right one, which is kept from then on
    "probe_table",  # the library vanishes while probes are changed
)
"""Drawn alone, too, within a scan."""
SCAN_SHARE, ALL_DEVICES = 0.06, -1
SIZES = {
    "clock_rate": (200.0, 2e4),
    "clock_drift": (0.1, 50.0),
    "device_stall": (1e-3, 1.0),
    "timer_loss": (1e-3, 1.0),
    "host_freeze": (1e-3, 3.0),
    "process_stall": (1e-3, 3.0),
    "loop_stall": (1e-3, 3.0),
    "delays": (5e-4, 0.05),
    "lost": (3e-3, 0.5),
    "corrupted": (3e-3, 0.5),
    "cut": (3e-3, 0.5),
    "garbage": (3e-3, 0.5),
    "utc_step": (0.1, 1e4),
    "utc_set": (0.1, 1e4),
    "utc_ahead": (1e3, 3e8),
    "preset": (8e-4, 0.5),
    "unread": (2e-3, 0.05),
    "clock_pair": (200.0, 2e4),
}
"""Least and greatest sizes of faults: ppm, ppm/s, seconds, shares of frames, turns."""
LASTING_S = {
    "delays": (5.0, 50.0),
    "utc_ahead": (5.0, 50.0),
    "utc_1970": (5.0, 50.0),
    "lost": (0.5, 8.0),
    "corrupted": (0.5, 8.0),
    "cut": (0.5, 8.0),
    "garbage": (0.5, 8.0),
    "usb_reset": (0.02, 2.0),
    "probe_table": (3.0, 8.0),
    "daemon_restart": (0.5, 5.0),
    "computer_restart": (0.5, 5.0),
}
STALLS = ("device_stall", "timer_loss", "host_freeze", "process_stall", "loop_stall")
SIGNED = ("clock_rate", "clock_drift", "utc_step", "utc_set")
FROM_START = (
    "unidentified",
    "unconfirmed",
    "clock_rate",
    "clock_drift",
    "utc_ahead",
    "utc_1970",
)
ONE_WAY_S = 5e-4
SEEN_PACES = ("hand", "fast")  # at which a joint is quick enough to be seen to stop
OF_POWER = ("board_restart", "exchange", "incremental")
OF_LINE = ("lost", "corrupted", "cut", "garbage")


def world_number(family: int, place: int) -> int:
    """The seed of a world of a family, by the family's number and the world's."""
    return place * len(FAMILIES) + family


def draw_plan(seed: int) -> Plan:
    """Draw a world; the families take turns."""
    family = tuple(FAMILIES.values())[seed % len(FAMILIES)]
    rng = np.random.default_rng([seed, 0x486F6E])
    n = family.n_devices
    duration_s = float(rng.uniform(20.0, 36.0))
    plan = Plan(
        seed,
        family.name,
        duration_s,
        rates_ppm=tuple(rng.uniform(-60.0, 60.0, n).tolist()),
        drifts_ppm_s=(0.0,) * n,
        delays_s=tuple(_delay(rng) for _ in range(n)),
        pace=str(rng.choice(["rest", "slow", "hand", "fast"], p=[0.1, 0.3, 0.4, 0.2])),
    )
    if rng.random() < FAULTLESS_SHARE:
        # Joints that are not latched at one instant have no business at this speed.
        if not family.latches and plan.pace in ("fast", "hand"):
            plan = replace(plan, pace="slow")
    else:
        kinds = [kind for kind in FAULT_KINDS if _suits(kind, family)]
        n_faults = int(rng.choice([1, 2, 3], p=[0.5, 0.3, 0.2]))
        for kind in rng.choice(kinds, min(n_faults, len(kinds)), replace=False):
            plan = _with_fault(plan, str(kind), rng)
        plan = _perhaps_in_scan(_perhaps_lone(plan))
    return replace(plan, actions=_actions(plan, rng))


def _delay(rng: np.random.Generator) -> tuple[float, float, float]:
    bunch_s = float(rng.choice([0.0, 0.0, 0.001]))
    return float(rng.uniform(2e-5, 3e-4)), float(rng.uniform(0.0, 3e-4)), bunch_s


def _suits(kind: str, family: Family) -> bool:
    if kind in ("clock_rate", "clock_drift", "device_stall", "timer_loss"):
        return family.has_clock
    if kind in ("swap", "incremental"):
        return family.can_swap if kind == "swap" else family.can_count
    if kind in ("corrupted", "garbage", "bus_off"):
        return (family.name == "canopen") == (kind == "bus_off")
    if kind in FROZEN_KINDS:
        return family.shows(kind)
    if kind == "unread":
        return family.has_board
    return kind != "clock_pair" or (family.has_clock and family.n_devices > 1)


def _with_fault(plan: Plan, kind: str, rng: np.random.Generator) -> Plan:
    device = int(rng.integers(len(plan.rates_ppm)))
    at_s = float(rng.uniform(EDGE_S, plan.duration_s - EDGE_S))
    lasts_s = float(rng.uniform(*LASTING_S.get(kind, (0.3, 4.0))))
    size = 0.0
    if kind in SIZES:
        least, most = SIZES[kind]
        size = float(np.exp(rng.uniform(np.log(least), np.log(most))))
    if kind in SIGNED:
        size *= float(rng.choice([-1, 1]))
    if kind in STALLS:
        lasts_s = size
    if kind == "clock_rate" and plan.family == "microscribe":
        size *= 10.0
    if kind in ("daemon_restart", "computer_restart"):
        size = float(rng.integers(3))  # devices stay, lose power, or are exchanged
    from_start = kind in FROM_START or (kind == "delays" and rng.random() < 0.5)
    fault = PlannedFault(kind, 0.0 if from_start else at_s, lasts_s, size, device)
    return _from_start(replace(plan, faults=(*plan.faults, fault)), fault, rng)


def _perhaps_lone(plan: Plan) -> Plan:
    """Draw a world with one of `LONE_KINDS`; it has random numbers of its own."""
    rng = np.random.default_rng([plan.seed, 0x4C6F6E65])
    kinds = [kind for kind in LONE_KINDS if _suits(kind, FAMILIES[plan.family])]
    if rng.random() > LONE_SHARE:
        return plan
    at_s = float(rng.uniform(EDGE_S, plan.duration_s - EDGE_S - MOST_LONE_S))
    lasts_s = float(rng.uniform(3.0, MOST_LONE_S))
    kind = str(rng.choice(kinds))
    if kind == "unread":
        lasts_s = plan.duration_s - at_s
    size = SLEW_PPM
    if kind in SIZES:
        size = float(np.exp(rng.uniform(*np.log(SIZES[kind]))))
    size *= float(rng.choice([-1, 1]))
    size = abs(size) if kind == "unread" else size
    plan = _without_faults(plan, rng)
    fault = PlannedFault(kind, at_s, lasts_s, size)
    plan = replace(
        plan,
        pace=str(rng.choice(SEEN_PACES)) if kind in FROZEN_KINDS else plan.pace,
        faults=(fault,),
    )
    return _from_start(plan, fault, rng)


def _without_faults(plan: Plan, rng: np.random.Generator) -> Plan:
    n = len(plan.rates_ppm)
    return replace(
        plan,
        faults=(),
        rates_ppm=tuple(rng.uniform(-60.0, 60.0, n).tolist()),
        drifts_ppm_s=(0.0,) * n,
        delays_s=tuple(_delay(rng) for _ in range(n)),
        is_identified=True,
        is_confirmed=True,
        is_incremental=False,
    )


def _perhaps_in_scan(plan: Plan) -> Plan:
    """Draw a world with one of `SCAN_KINDS`; it has random numbers of its own."""
    rng = np.random.default_rng([plan.seed, 0x5363616E])
    if rng.random() > SCAN_SHARE:
        return plan
    kinds = [kind for kind in SCAN_KINDS if _suits(kind, FAMILIES[plan.family])]
    kind = str(rng.choice(kinds))
    plan = _with_fault(replace(_without_faults(plan, rng), in_scan=True), kind, rng)
    if kind == "probe_table" and rng.random() < 0.5:
        restart = PlannedFault("daemon_restart", plan.faults[0].at_s + 1.5, 0.5)
        plan = replace(plan, faults=(*plan.faults, restart))
    if kind == "usb_reset" and rng.random() < 0.5:
        fault = replace(plan.faults[0], device=ALL_DEVICES)
        plan = replace(plan, faults=(fault,))
    return plan


def least_delay_s(plan: Plan, fault: PlannedFault) -> float:
    """Return the smallest delay that a fault of delays leaves.

    Of a device that is never asked it is unknown: the port's statement is taken.
    """
    spec = FAMILIES[plan.family].devices[fault.device]
    return min(fault.size, ONE_WAY_S) if spec.id == "text" else fault.size


def _from_start(plan: Plan, fault: PlannedFault, rng: np.random.Generator) -> Plan:
    """Apply faults that are there from the beginning."""
    kind, device = fault.kind, fault.device
    rates, drifts = list(plan.rates_ppm), list(plan.drifts_ppm_s)
    delays = list(plan.delays_s)
    if kind == "clock_rate":
        rates[device] = fault.size
    elif kind == "clock_pair":
        rates = [fault.size * (-1) ** number for number in range(len(rates))]
    elif kind == "clock_drift":
        drifts[device] = fault.size
    elif kind == "delays" and not fault.at_s:
        usual_s = float(10 ** rng.uniform(-4, -1.6))
        fault = replace(fault, size=least_delay_s(plan, fault))
        delays[device] = fault.size, usual_s, float(rng.choice([0.0, 0.004, 0.016]))
    return replace(
        plan,
        rates_ppm=tuple(rates),
        drifts_ppm_s=tuple(drifts),
        delays_s=tuple(delays),
        is_identified=plan.is_identified and kind != "unidentified",
        is_confirmed=plan.is_confirmed and kind != "unconfirmed",
        is_incremental=plan.is_incremental or kind == "incremental",
    )


def _actions(plan: Plan, rng: np.random.Generator) -> tuple[Action, ...]:
    """Draw the operator's actions: confirm first, then points, means and scans."""
    confirm = "home" if plan.is_incremental else "confirm"
    actions = [Action(2.5, confirm)] if plan.is_confirmed else []
    actions += [Action(at_s + 2.5, "home") for at_s in plan.homes_s[1:]]
    at_s = 3.0
    while at_s < plan.duration_s - 3.0:
        kind = str(
            rng.choice(["point", "mean", "scan", "confirm"], p=[0.5, 0.2, 0.2, 0.1])
        )
        size = float(rng.uniform(0.5, 3.0)) if kind == "scan" else 0.0
        if kind != "confirm" or (plan.is_confirmed and not plan.is_incremental):
            actions.append(Action(at_s, kind, size))
        at_s += size + float(rng.exponential(1.5)) + 0.3
    if plan.in_scan:
        actions = _with_scan(plan, actions, rng)
    return tuple(sorted(actions, key=lambda action: action.at_s))


def _with_scan(
    plan: Plan, actions: list[Action], rng: np.random.Generator
) -> list[Action]:
    """Add a scan from before a fault until after it; then the operator confirms."""
    fault = plan.faults[0]
    begin_s = fault.at_s - float(rng.uniform(0.2, 1.0))
    end_s = fault.at_s + min(fault.lasts_s, 2.0) + float(rng.uniform(0.5, 2.0))
    before_s = begin_s - ANSWER_S
    actions = [
        action
        for action in actions
        if action.kind in ("home", "confirm")
        or action.at_s + action.size < before_s
        or action.at_s > end_s + 1.0
    ]
    actions.append(Action(begin_s, "scan", end_s - begin_s))
    if plan.is_confirmed and not plan.is_incremental:
        actions.append(Action(end_s + 0.5, "confirm"))
    if fault.kind == "probe_table":
        at_s = np.arange(4.0, plan.duration_s - 3.0, 2.7).tolist()
        actions += [Action(t, "probe", float(rng.integers(2))) for t in at_s]
    return actions
