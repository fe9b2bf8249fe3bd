"""A new kind of effect takes its file, its row and the simulator's maker: no more."""

import json
import os
import sys
from collections.abc import Iterable
from pathlib import Path

import pytest

from tests.lab.planted_kind import KIND, LABEL, WALKS
from tests.running import run_program

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
PACKAGES = sorted(path for path in (ROOT / "src" / "traverse").iterdir())

LAW = f'''"""d_alpha = cos_rad cos(alpha / 2) + sin_rad sin(alpha / 2)."""

from dataclasses import dataclass
from typing import Any, ClassVar

from traverse.kinematics.effects.readings.harmonics import EncoderHarmonic


@dataclass(frozen=True, slots=True, kw_only=True)
class HalfWave(EncoderHarmonic):
    """Half a period a turn."""

    kind: ClassVar[str] = "{KIND}"

    @classmethod
    def surroundings(cls, effect: Any, setting: Any) -> dict[str, Any]:
        return {{"order": 0.5}}
'''
ROW = f'''
        "{KIND}": EffectKind(
            family=Family.OWN_ANGLE,
            effect_class="L",
            joint="required",
            keys={{"cos_rad": float, "sin_rad": float}},
            acts_on="angle",
            size=2e-5,
            covariates=("{{}}_rad",),
            label="{LABEL}",
        ),
        "empirical": EffectKind('''
LAWS = "READING_LAWS: dict[str, Callable[[EffectEntry, JointState], Floats]] = {"
PLAYED = f'''{LAWS}
    "{KIND}": lambda e, seen: (
        e["cos_rad"] * np.cos(0.5 * seen.readings_rad[:, e.joints])
        + e["sin_rad"] * np.sin(0.5 * seen.readings_rad[:, e.joints])
    ),'''


def planted(folder: Path, *left_out: str, walks: Iterable[str] = ()) -> dict[str, str]:
    """Plant the kind in a copy of the packages; what became of the walks, or of all."""
    for package in PACKAGES:
        target = folder / "traverse" / package.name
        target.parent.mkdir(exist_ok=True)
        # Folders as links, but for those in which something is planted.
        target.symlink_to(package.resolve())
    places = {
        "kinematics/effect_table.py": ('\n        "empirical": EffectKind(', ROW),
        "simulator/effects/laws.py": (LAWS, PLAYED),
    }
    for name in ("kinematics", "simulator"):
        link = folder / "traverse" / name
        _copied(link.resolve(), link)
    for place, (where, replacement) in places.items():
        file = folder / "traverse" / place
        text = file.read_text("utf-8")
        assert text.count(where) == 1
        if place not in left_out:
            file.write_text(text.replace(where, replacement), "utf-8")
    if "law" not in left_out:
        laws = folder / "traverse" / "kinematics" / "effects" / "readings"
        (laws / f"{KIND}.py").write_text(LAW, "utf-8")
    run = run_program(
        *(sys.executable, "-m", "tests.lab.planted_kind", *walks),
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(folder), "OPENBLAS_NUM_THREADS": "1"},
        status=None,
    )
    if run.returncode:
        return {"import": run.stderr}
    return json.loads(run.stdout)


def _copied(source: Path, target: Path) -> None:
    """Put a folder of links to files where a link to a folder was."""
    target.unlink()
    for path in source.rglob("*"):
        if path.is_file() and path.suffix != ".pyc":
            copy = target / path.relative_to(source)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(path.read_bytes())


def test_every_place_knows_a_planted_kind(tmp_path):
    assert planted(tmp_path) == dict.fromkeys(WALKS, "passed")


def test_without_its_law_no_effect_is_built(tmp_path):
    outcomes = planted(tmp_path, "law")
    assert outcomes.pop("walk_docs") == "passed"  # it builds none
    assert set(outcomes.values()) == {f"failed: KeyError '{KIND}'"}


def test_without_the_simulators_maker_it_is_not_played(tmp_path):
    walks = ("walk_simulator", "walk_arm_file")
    outcomes = planted(tmp_path, "simulator/effects/laws.py", walks=walks)
    assert outcomes == {
        "walk_simulator": f"failed: KeyError '{KIND}'",
        "walk_arm_file": "passed",
    }
