"""`python -m benchmarks.strangers DIR`: the table of docs/strangers.md.

Each arm is identified with some of its poses and judged by all of the others, beside
the nominal arm with its tool fitted, and beside plain least squares by scipy.
"""

import argparse
import json
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.strangers import plain
from benchmarks.strangers.sets import Measured, make_arm, read_sets
from traverse.arrays import Floats
from traverse.kinematics.arm_file.arm import Arm, read_arm
from traverse.lab.campaign.campaign import Campaign, read_campaign
from traverse.lab.diagnosis.diagnose import diagnose
from traverse.lab.diagnosis.model.result import DiagnosisOptions
from traverse.lab.identification.identify import IdentificationError, identify
from traverse.lab.identification.prediction import placed, places_of, predict

HEAD = (
    "| set | poses used | kept aside | tool alone | scipy | pybotics | Traverse "
    "| diagnosed | the owners' figures |\n|---|---|---|---|---|---|---|---|---|"
)


def main() -> None:
    """Print a row for each set."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[2])
    parser.add_argument("folder", type=Path, help="with the sets, as described")
    parser.add_argument("--only", help="sets whose name begins so")
    parser.add_argument(
        "--diagnose", action="store_true", help="also with the effects that are found"
    )
    parser.add_argument(
        "--pybotics", metavar="PYTHON", help="interpreter that has pybotics"
    )
    asked = parser.parse_args()
    print("Distance of poses kept aside: mean, largest [mm].", HEAD, sep="\n\n")
    for measured in read_sets(asked.folder):
        if measured.name.startswith(asked.only or ""):
            print(row(measured, asked.pybotics, asked.diagnose), flush=True)


def row(measured: Measured, pybotics: str | None, with_diagnosis: bool) -> str:
    """Compute one row of the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        arm = read_arm(make_arm(measured, folder))
        names = [joint.name for joint in arm.joints]
        used = measured.write(folder / "used", ~measured.is_kept)
        kept = measured.write(folder / "kept", measured.is_kept)
        given, judged = read_campaign(used, names), read_campaign(kept, names)
    nominal = plain.chain_of(arm)
    tool = plain.fitted(nominal, measured, tool_only=True)
    rival = plain.fitted(tool, measured)
    cells = [
        measured.name,
        str(len(given.poses)),
        f"{measured.held_by}: {len(judged.poses)}",
        figures(plain.held_out_mm(tool, measured)),
        figures(plain.held_out_mm(rival, measured)),
        by_pybotics(measured, pybotics),
        *ours(given, judged, arm, measured.was_moved, with_diagnosis),
        measured.owners,
    ]
    return f"| {' | '.join(cells)} |"


def by_pybotics(measured: Measured, python: str | None) -> str:
    """What pybotics makes of a set that a tracker measured."""
    if python is None or measured.places_mm is None:
        return "-"
    given = {
        "rows": measured.classic_rows,
        "tool_mm": measured.tool_mm,
        "angles_rad": measured.angles_rad.tolist(),
        "places_mm": measured.places_mm.tolist(),
        "is_kept": measured.is_kept.tolist(),
        "was_moved": measured.was_moved,
    }
    script = Path(__file__).parent.parent / "peers" / "pybotics_fit.py"
    ran = subprocess.run(
        [python, script],
        check=False,
        input=json.dumps(given),
        capture_output=True,
        text=True,
    )
    if ran.returncode:
        return ran.stderr.strip().splitlines()[-1]
    return figures(np.array(json.loads(ran.stdout)["distances_mm"]))


def ours(
    given: Campaign, judged: Campaign, arm: Arm, was_moved: bool, with_diagnosis: bool
) -> tuple[str, str]:
    """Identify, and diagnose what is left; what each of the arms predicts."""
    begun_s = time.monotonic()
    try:
        identified = identify(given, arm).arm
    except IdentificationError as error:
        return str(error), "-"
    plainly = figures(distances_mm(given, judged, identified, was_moved=was_moved))
    plainly += f" ({time.monotonic() - begun_s:.0f} s)"
    if not with_diagnosis:
        return plainly, "-"
    begun_s = time.monotonic()
    found = diagnose(given, identified, DiagnosisOptions())
    told = figures(distances_mm(given, judged, found.adapted, was_moved=was_moved))
    n = sum(term.accepted for term in found.terms)
    taken_s = time.monotonic() - begun_s
    return plainly, f"{told}, {found.verdict}, {n} terms ({taken_s:.0f} s)"


def distances_mm(
    given: Campaign, judged: Campaign, arm: Arm, *, was_moved: bool = False
) -> Floats:
    """Distances [mm] of all held-out poses; artefacts placed as far as known."""
    places = {} if was_moved else places_of(placed(given, arm))
    return predict(judged, arm, places).distances_mm


def figures(distances: Floats) -> str:
    """Mean and largest."""
    return f"{np.mean(distances):.3f}, {np.max(distances):.2f}"


if __name__ == "__main__":
    main()
