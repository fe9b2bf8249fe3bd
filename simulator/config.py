"""The simulator's configuration file (docs/reference/simulator.md)."""

from collections.abc import Iterator, Mapping
from typing import Any, Literal

from pydantic import AwareDatetime, Field

from traverse.simulator.arm.truth import Deviations
from traverse.simulator.devices.table import AnyDevice
from traverse.simulator.motions import AnyMotion
from traverse.simulator.motions.stage import Operator
from traverse.simulator.scenario.course import ClimateTable
from traverse.simulator.scenario.faults import AnyFault
from traverse.strict_toml.problems import Problem, tables_in
from traverse.strict_toml.reader import StrictModel


class ArmTable(StrictModel):
    """The virtual arm."""

    file: str
    true_file: str | None = None
    deviations: Deviations = Deviations()
    turn_limits_rad: tuple[tuple[float, float], ...] | None = None
    noise_rad: float = Field(default=0.0, ge=0.0)


class SimulatorConfig(StrictModel):
    """The whole file."""

    schema_: Literal["traverse/simulator/1"] = Field(alias="schema")
    seed: int = Field(default=1, ge=0)
    clock: Literal["real", "fast"] = "real"
    start: Literal["power_up", "first_start"] = "power_up"
    start_utc: AwareDatetime | None = None
    repeat: bool = False
    exit_at_end: bool = False
    truth_log: str | None = None
    truth_readings: bool = False
    arm: ArmTable
    climate: ClimateTable = ClimateTable()
    operator: Operator = Operator()
    device: tuple[AnyDevice, ...]
    motion: tuple[AnyMotion, ...]
    fault: tuple[AnyFault, ...] = ()


def config_problems(raw: Mapping[str, Any]) -> Iterator[Problem]:
    for key in ("device", "motion"):
        if raw.get(key) == []:
            yield Problem(key, "is empty; at least one is needed")
    yield from _device_problems(raw)
    motions = tables_in(raw.get("motion"))
    for number, motion in enumerate(motions):
        kind = motion.get("kind")
        if kind == "replay" and len(motions) > 1:
            where = f"motion[{number}].kind"
            yield Problem(where, "a replay is the whole script; remove the others")
    arm = raw.get("arm")
    if isinstance(arm, Mapping) and "true_file" in arm and "deviations" in arm:
        yield Problem("arm.deviations", "true_file says the truth; remove one of them")
    if raw.get("repeat") is True and raw.get("exit_at_end") is True:
        yield Problem("exit_at_end", "a script that repeats has no end; remove one")


def _device_problems(raw: Mapping[str, Any]) -> Iterator[Problem]:
    """Find duplicate names, and faults of unknown devices."""
    devices = tables_in(raw.get("device"))
    for keys in (("id",), ("port", "ports")):
        used_names: set[str] = set()
        for number, key in ((n, k) for n in range(len(devices)) for k in keys):
            entries = devices[number].get(key, [])
            for name in map(str, entries if isinstance(entries, list) else [entries]):
                if name in used_names:
                    message = f"'{name}' is used twice; each needs its own"
                    yield Problem(f"device[{number}].{key}", message)
                used_names.add(name)
    ids = {str(device.get("id")) for device in devices}
    for number, fault in enumerate(tables_in(raw.get("fault"))):
        named = fault.get("device")
        if isinstance(named, str) and named not in ids:
            where = f"fault[{number}].device"
            yield Problem(where, f"no device '{named}'; there are {sorted(ids)}")
