"""Every chain of a zoo of robot descriptions, imported and compared at its end.

python -m benchmarks.zoo [FOLDER]

FOLDER has files *.urdf at any depth; by default those of the package example-robot-data
in this environment (`make bench-zoo`). A chain is right where the arm file's ball is
where a walk of its own (`walk.py`) has the end, at random readings; refused clearly
where the walk finds the reason, and where with --hold-mm and --hold-rad it is right;
else refused wrongly. Exit status 1: a chain is wrong, or refused wrongly.
"""

import os
import sys
import sysconfig
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.tools.command_line import run_main
from benchmarks.zoo import walk
from traverse.cli.arm.making import MadeArm, arm_from_urdf_file
from traverse.cli.arm.options import ArmOptions
from traverse.kinematics.importers.urdf_chain import Holds
from traverse.kinematics.model.forward import probe_pose
from traverse.kinematics.model.geometry import geometry_from_arm
from traverse.strict_toml.problems import FileError

PACKAGE = "cmeel.prefix/share/example-robot-data/robots"
POSTURES = 5
# Rounding: the arm file has 12 decimals, of mm and more of directions.
TOLERANCE_MM = 1e-8
TINY_FILES = 3


@dataclass
class Tally:
    """Chains by outcome, the largest difference, and errors."""

    outcomes: Counter[str] = field(default_factory=Counter)
    largest_mm: float = 0.0
    complaints: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Case:
    """One chain of a description."""

    path: Path
    every: walk.Description
    chain: list[walk.Joint]
    rng: np.random.Generator

    @property
    def name(self) -> str:
        return f"{self.path.name} to {self.chain[-1].child}"

    def imported(self, holds: Holds) -> MadeArm:
        """Import the chain; raises FileError where it is refused."""
        root, tip = self.chain[0].parent, self.chain[-1].child
        return arm_from_urdf_file(self.path, root, tip, holds, ArmOptions())


def judge(path: Path, tally: Tally, rng: np.random.Generator) -> None:
    try:
        every = walk.read(path)
    except ValueError as error:
        _judge_refusal(path, tally, str(error))
        return
    for tip in every.ends():
        chain = every.chain(tip)
        if sum(joint.kind in walk.TURNING for joint in chain):
            tally.outcomes[_outcome(Case(path, every, chain, rng), tally)] += 1


def _judge_refusal(path: Path, tally: Tally, reason: str) -> None:
    """A file that the walk does not understand has to be refused as a whole."""
    try:
        arm_from_urdf_file(path, None, None, Holds(), ArmOptions())
    except FileError:
        tally.outcomes["refused clearly"] += 1
    else:
        tally.outcomes["read what the walk refuses"] += 1
        tally.complaints.append(f"{path.name}: read, but {reason}")


def _outcome(case: Case, tally: Tally) -> str:
    reasons = set(_reasons(case.chain))
    try:
        imported, holds = case.imported(Holds()), Holds()
    except FileError as error:
        if not reasons:
            tally.complaints.append(f"{case.name}: refused: {error.line[:300]}")
            return "refused wrongly"
        holds = _holds(case.chain, case.rng)
        try:
            imported = case.imported(holds)
        except FileError as held_error:
            if reasons & {"floating", "planar"} or _without_hinge(case.chain, holds):
                return "refused clearly"
            tally.complaints.append(f"{case.name}: refused: {held_error.line[:300]}")
            return "refused wrongly"
        return _compared(case, imported, holds, tally)
    if reasons:
        tally.complaints.append(f"{case.name}: read in spite of {', '.join(reasons)}")
    return _compared(case, imported, holds, tally)


def _reasons(chain: list[walk.Joint]) -> Iterator[str]:
    """Yield why a chain is no arm's."""
    on_chain = {joint.name: joint for joint in chain}
    for joint in chain:
        if joint.kind in ("prismatic", "floating", "planar"):
            yield joint.kind
        elif joint.kind in walk.TURNING and joint.mimic is not None:
            master, passed = joint.name, set[str]()
            while master in on_chain and master not in passed:
                passed.add(master)
                mimic = on_chain[master].mimic
                if mimic is None:
                    break
                master = mimic[0]
            last = on_chain.get(master)
            if last is None or last.mimic is not None or last.kind not in walk.TURNING:
                yield "a mimic of a joint elsewhere"


def _holds(chain: list[walk.Joint], rng: np.random.Generator) -> Holds:
    """Hold sliding joints, and those that mimic a joint elsewhere."""
    mm, rad = dict[str, float](), dict[str, float]()
    names = {joint.name for joint in chain}
    for joint in chain:
        if joint.kind == "prismatic":
            mm[joint.name] = float(rng.uniform(-50, 50))
        elif joint.mimic is not None and joint.mimic[0] not in names:
            rad[joint.name] = float(rng.uniform(-1, 1))
    return Holds(mm, rad)


def _without_hinge(chain: list[walk.Joint], holds: Holds) -> bool:
    return all(
        joint.kind not in walk.TURNING or joint.name in holds.rad for joint in chain
    )


def _compared(case: Case, imported: MadeArm, holds: Holds, tally: Tally) -> str:
    """Compare the ball with the end of the walk at random readings."""
    geometry = geometry_from_arm(imported.arm)
    held = {name: 1e-3 * mm for name, mm in holds.mm.items()} | dict(holds.rad)
    old = {
        imported.renamed.get(joint.name, joint.name): joint.name for joint in case.chain
    }
    for _ in range(POSTURES):
        values, readings = dict[str, float](), list[float]()
        for joint in imported.arm.joints:
            reading = joint.zero_rad
            if joint.coupled_to is None:
                reading = values[old[joint.name]] = float(case.rng.uniform(-3, 3))
            readings.append(reading)
        ball_mm = probe_pose(geometry, np.array([readings]))[0][0]
        expected_mm = walk.place_mm(case.chain, values | held, case.every)
        off_mm = float(np.abs(ball_mm - expected_mm).max())
        tally.largest_mm = max(tally.largest_mm, off_mm)
        if not off_mm <= TOLERANCE_MM:
            tally.complaints.append(f"{case.name}: {off_mm:.3g} mm off")
            return "wrong"
    return "refused clearly, right where held" if held else "right"


def main(folder: Path | None = None) -> int:
    folder = folder or Path(sysconfig.get_path("purelib"), PACKAGE)
    files = sorted(folder.rglob("*.urdf"))
    if not files:
        sys.stderr.write(f"{folder}: no robot descriptions; `make bench-zoo`\n")
        return 2
    if os.environ.get("TINY"):
        files = files[:TINY_FILES]
    tally, rng = Tally(), np.random.default_rng(1)
    for path in files:
        judge(path, tally, rng)
    print(f"{len(files)} descriptions, {tally.outcomes.total()} chains")
    for outcome in ("right", "refused clearly, right where held", "refused clearly"):
        print(f"{outcome}: {tally.outcomes.pop(outcome, 0)}")
    print(f"refused wrongly: {tally.outcomes.pop('refused wrongly', 0)}")
    print(f"wrong, or read in spite of a reason: {tally.outcomes.total()}")
    print(f"largest difference at the end: {tally.largest_mm:.2g} mm")
    for complaint in tally.complaints[:50]:
        print(f"  {complaint}")
    return 1 if tally.complaints else 0


if __name__ == "__main__":
    run_main(main)
