"""A hinge that turns steadily, for devices under test."""

from pathlib import Path

import numpy as np

from traverse.simulator.arm.trajectory import Trajectory, rest_pieces
from traverse.simulator.arm.truth import EncoderSet
from traverse.simulator.devices.device import DeviceContext
from traverse.simulator.scenario.course import ClimateTable
from traverse.simulator.scenario.faults import Fault
from traverse.simulator.scenario.script import Script
from traverse.simulator.scenario.wiring import ScriptClock

COUNTS_PER_S = 1000.0


class SteadyCounts:
    """Channel k shows 1000 (t + k) counts, below its modulus."""

    def __init__(self, moduli) -> None:
        self.moduli = np.array(moduli)

    def counts(self, script_s, noise):
        del noise
        ahead = np.arange(len(self.moduli))
        counts = np.rint(COUNTS_PER_S * (script_s[:, None] + ahead))
        return counts.astype(np.int64) % self.moduli


class Notebook:
    def __init__(self) -> None:
        self.readings = []
        self.edges = []
        self.drops = []

    def edge(self, device, seq, edge) -> None:
        self.edges.append((device, seq, edge))

    def reading(self, device, channel, time_s, count, status) -> None:
        self.readings.append((device, channel, time_s, count, status))

    def dropped(self, device, n_samples, time_s, stood_s) -> None:
        self.drops.append((device, n_samples, time_s, stood_s))


def mounted(folder: Path, table, *faults, n_channels=2, per_turn=65536, events=()):
    """A mounting for a table; the script begins at the first reading."""
    per_turns = np.full(n_channels, per_turn)
    moduli = per_turns * table.encoder_turns
    resting = Trajectory(np.array([0.0, 3600.0]), rest_pieces(np.zeros(n_channels)))
    played = tuple(Fault.from_table(fault) for fault in faults)
    assert all(fault.kind in table.FAULTS for fault in played)
    return DeviceContext(
        folder,
        EncoderSet(np.arange(n_channels), per_turns, np.ones(n_channels), moduli, 0.0),
        SteadyCounts(moduli),
        Script(resting, tuple(events), repeat=False),
        ScriptClock(0.0),
        played,
        (7, 0),
        Notebook(),
        ClimateTable(),
    )
