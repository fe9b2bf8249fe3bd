"""When a plan ends and begins programs, and how it makes clocks run."""

from benchmarks.honesty.plan import Plan
from benchmarks.honesty.timeline import ClockFault, Timeline


def restarts(plan: Plan) -> list[tuple[float, float, str]]:
    """Return when the daemon ends and begins again, and a board's change meanwhile."""
    pauses: list[tuple[float, float, str]] = []
    for fault in sorted(plan.faults, key=lambda fault: fault.at_s):
        if fault.kind in ("daemon_restart", "computer_restart"):
            begin_s = max(fault.at_s, pauses[-1][1] + 1.0 if pauses else 0.0)
            lasts_s = max(fault.lasts_s, 0.5)
            kind = ("", "board_restart", "exchange")[int(fault.size)]
            pauses.append((begin_s, begin_s + lasts_s, kind))
    return pauses


def host_timeline(plan: Plan) -> Timeline:
    stands = [
        ClockFault(f.at_s, stands_s=f.lasts_s)
        for f in plan.faults
        if f.kind == "host_freeze"
    ]
    slews = [
        ClockFault(f.at_s, stands_s=f.lasts_s, rate=1.0 + 1e-6 * f.size)
        for f in plan.faults
        if f.kind == "host_slew"
    ]
    return Timeline(faults=[*stands, *slews])


def device_timeline(plan: Plan, number: int) -> Timeline:
    stands = [
        ClockFault(f.at_s, stands_s=f.lasts_s)
        for f in sorted(plan.faults, key=lambda fault: fault.at_s)
        if f.kind in ("device_stall", "timer_loss") and f.device == number
    ]
    return Timeline(
        1.0 + 1e-6 * plan.rates_ppm[number],
        1e-6 * plan.drifts_ppm_s[number],
        plan.duration_s,
        stands,
    )
