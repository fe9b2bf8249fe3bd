import json
import os
import pty
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests import results
from tests.cli.identify.identification import run_identify, said_json
from tests.running import END_S, run_program
from traverse.kinematics.arm_file.arm import Arm, read_arm, write_arm

FILES = {
    "arm.toml",
    "arm.cov.npz",
    "identification.json",
    "SHA256SUMS",
    "residuals.csv",
    "report.html",
}


@pytest.fixture
def measured(tmp_path: Path) -> Path:
    """A folder with a campaign that determines everything, and the arm file."""
    return shutil.copytree(results.measured(), tmp_path / "measured")


@pytest.fixture(scope="module")
def lengthless(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lengthless")
    results.write_simulated(folder, "cones", 80)
    return folder


@pytest.fixture(scope="session")
def identified() -> Path:
    """The folder with results in `out` and the output in `said`."""
    return results.identified()


def test_all_files_are_written(identified: Path) -> None:
    assert {path.name for path in (identified / "out").iterdir()} == FILES
    arm = read_arm(identified / "out" / "arm.toml")
    assert arm.identification is not None
    assert arm.identification.covariance_file == "arm.cov.npz"
    assert [j.encoder for j in arm.joints] == [
        j.encoder for j in read_arm(results.ARM).joints
    ]


def test_json_is_as_the_contract_says(identified: Path) -> None:
    document = json.loads(
        (identified / "out" / "identification.json").read_text("utf-8")
    )
    number = (int, float)
    assert_shape(
        document,
        {
            "schema": str,
            "converged": bool,
            "iterations": int,
            "sigma0": number,
            "redundancy": int,
            "global_test": {"p_value": number, "passed": bool},
            "rms_mm": {"before": number, "after": number},
            "undetermined": list,
            "excluded": list,
            "artefacts": {
                "bar": {
                    "n": int,
                    "rms_mm": number,
                    "distance_mm": {"value": number, "std": number},
                },
                "cone-1": {"n": int, "rms_mm": number},
            },
        },
    )
    assert document["schema"] == "traverse/identification/1"
    assert document["converged"] is True
    assert document["undetermined"] == []
    assert document["holdout"] is None
    for entry in document["parameters"]:
        assert list(entry) == ["name", "value", "unit", "std", "controllability"]
        assert entry["unit"] == ("rad" if ".axis." in entry["name"] else "mm")
        assert 0.0 <= entry["controllability"] <= 1.0
        assert entry["std"] > 0.0
    assert len(document["parameters"]) == 4 * 7 - 3
    assert document["rms_mm"]["after"] < 0.02 < document["rms_mm"]["before"]


def assert_shape(value: Any, shape: Any) -> None:
    if isinstance(shape, Mapping):
        for key, inner in shape.items():
            assert_shape(value[key], inner)
    else:
        assert isinstance(value, shape)
        assert shape is not int or not isinstance(value, bool)


def test_piped_output_is_plain_lines_and_progress_is_quiet(identified: Path) -> None:
    output = (identified / "said").read_text("utf-8")
    assert (identified / "errors").read_text("utf-8") == ""
    assert not set(output) & {"\r", "\x1b", "\b", "\t"}
    lines = output.splitlines()
    assert lines[0] == "demo-7: 160 poses at 6 artefacts"
    assert lines[1].startswith("sigma0 = ")
    assert lines[-1].startswith("wrote out: arm.toml, ")
    assert any("mm with the arm file as given" in line for line in lines)
    assert "All 25 free parameters are determined." in lines


def test_a_terminal_sees_a_line_for_every_iteration_and_json_is_what_is_written(
    measured: Path,
) -> None:
    ours, theirs = pty.openpty()
    arguments = ("campaign", "--arm", "arm.toml", "--out", "seen", "--json")
    ran = subprocess.run(
        [sys.executable, "-m", "traverse", "identify", *arguments],
        stdout=subprocess.PIPE,
        stderr=theirs,
        text=True,
        timeout=END_S,
        check=True,
        cwd=measured,
    )
    os.close(theirs)
    progress = os.read(ours, 1 << 16).decode().replace("\r\n", "\n").splitlines()
    os.close(ours)
    printed = json.loads(ran.stdout)
    assert printed == json.loads((measured / "seen/identification.json").read_text())
    assert len(progress) == printed["iterations"]
    assert progress[0].startswith("iteration   1: misfit ")
    assert all("sigma" in line and "directions determined" in line for line in progress)
    assert all(" mm rms, " in line for line in progress)


@pytest.mark.slow
def test_an_undetermined_scale_makes_no_arm_file(lengthless: Path) -> None:
    arguments = ("campaign", "--arm", "arm.toml", "--out", "out")
    ran = run_identify(lengthless, *arguments, status=1)
    assert "The scale of the arm is undetermined" in ran.stdout
    assert "Add a length standard: a ball bar" in ran.stdout
    assert "plausible deviation" in ran.stdout
    assert not (lengthless / "out" / "arm.toml").exists()
    assert not (lengthless / "out" / "arm.cov.npz").exists()
    page = (lengthless / "out" / "report.html").read_text("utf-8")
    assert '<div class="verdict bad">' in page


@pytest.mark.slow
def test_no_convergence_is_reported_and_leaves_no_arm_file(measured: Path) -> None:
    other = measured / "nonsense"
    shutil.copytree(measured / "campaign", other)
    header, *rows = (other / "poses.csv").read_text("utf-8").splitlines()
    rng = np.random.default_rng(1)
    names = header.split(",")
    spoilt = [header]
    for row in rows[::16]:
        cells = dict(zip(names, row.split(","), strict=True))
        readings = {f"J{k}_rad": f"{rng.uniform(-1e3, 1e3)}" for k in range(1, 8)}
        spoilt.append(",".join((cells | readings).values()))
    (other / "poses.csv").write_text("\n".join(spoilt) + "\n", "utf-8")
    words = ("nonsense", "--arm", "arm.toml", "--out", "none", "--hold", "J[1-6].*")
    ran = run_identify(measured, *words, status=1)
    assert "did not converge" in ran.stdout
    names = {path.name for path in (measured / "none").iterdir()}
    assert names == {"identification.json", "report.html"}


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ((), "CAMPAIGN, --arm, --out missing; or give --compare A B"),
        (("campaign", "--arm", "arm.toml"), "--out missing"),
        (
            ("campaign", "--arm", "absent.toml", "--out", "o"),
            "absent.toml: cannot be read",
        ),
        (("absent", "--arm", "arm.toml", "--out", "o"), "absent: cannot be read"),
        (
            ("campaign", "--arm", "arm.toml", "--out", "o", "--hold", "J9.*"),
            "'J9.*' fits no parameter",
        ),
        (
            ("campaign", "--arm", "arm.toml", "--out", "arm.toml"),
            "--out arm.toml is no folder",
        ),
        (("--compare", "arm.toml", "absent"), "absent: cannot be read"),
        (("--compare", "arm.toml", "campaign/poses.csv"), "poses.csv: "),
    ],
)
def test_refused_input_is_named_with_status_2(
    measured: Path, arguments: tuple[str, ...], expected: str
) -> None:
    ran = run_identify(measured, *arguments, status=2)
    assert ran.stdout == ""
    assert expected in ran.stderr
    assert "Traceback" not in ran.stderr


def test_an_effect_that_does_not_fit_the_arm_is_refused(measured: Path) -> None:
    values = read_arm(results.ARM).model_dump(by_alias=True, exclude_unset=True)
    effect = {"kind": "joint_compliance", "joint": "J3", "compliance_rad_nm": 1e-6}
    write_arm(
        measured / "bent.toml", Arm.model_validate({**values, "effects": (effect,)})
    )
    ran = run_identify(
        measured, "campaign", "--arm", "bent.toml", "--out", "o", status=2
    )
    assert "joint_compliance yields to weights" in ran.stderr


@pytest.mark.parametrize("package", ["scipy", "matplotlib"])
def test_a_missing_extra_is_named(measured: Path, package: str) -> None:
    program = (
        f"import sys; sys.modules[{package!r}] = None\n"
        "from traverse.cli.__main__ import main; main()"
    )
    arguments = ("identify", "campaign", "--arm", "arm.toml", "--out", "o")
    ran = run_program(sys.executable, "-c", program, *arguments, cwd=measured, status=2)
    assert f"needs {package}" in ran.stderr
    assert "run: make venv" in ran.stderr
    assert "Traceback" not in ran.stderr


@pytest.mark.slow
def test_two_results_are_compared_at_the_probe(identified: Path) -> None:
    truth = "campaign/truth/arm.toml"
    design = said_json(
        run_identify(identified, "--compare", truth, "arm.toml", "--json")
    )
    comparison = said_json(
        run_identify(identified, "--compare", truth, "out", "--json")
    )
    assert comparison["rms_mm"] < 0.05
    assert design["rms_mm"] > 0.2
    assert comparison["arms"][1]["redundancy"] > 0
    assert set(comparison["largest_at_rad"]) == {f"J{k}" for k in range(1, 8)}
    within = said_json(
        run_identify(identified, "campaign", "--compare", truth, "out", "--json")
    )
    assert within["largest_mm"] != comparison["largest_mm"]
    lines = run_identify(identified, "--compare", truth, "out").stdout.splitlines()
    assert lines[0] == f"A: {truth}: demo-7, design, not identified"
    assert lines[1].startswith("B: out/arm.toml: demo-7, identified ")
    assert f"rms {comparison['rms_mm']:.4f} mm" in lines[3]


@pytest.mark.slow
def test_held_parameters_are_not_estimated_also_by_a_file_of_masks(
    measured: Path, tmp_path: Path
) -> None:
    masks = tmp_path / "masks.toml"
    schema = 'schema = "traverse/identification-masks/1"\n'
    masks.write_text(schema + 'hold = ["J2.*"]\n')
    words = ("campaign", "--arm", "arm.toml", "--out", str(tmp_path / "out"), "--json")
    words += ("--hold", "J7.*", "--hold", "J6.link.?", "--masks", str(masks))
    document = said_json(run_identify(measured, *words, status=1))
    names = {entry["name"] for entry in document["parameters"]}
    assert not any(name.startswith(("J2.", "J7.", "J6.link.")) for name in names)
    assert "J6.axis.v" in names
    masks.write_text(schema + 'held = ["J2.*"]\n')
    refused = run_identify(measured, *words, status=2)
    assert "held: unknown key 'held'; did you mean 'hold'?" in refused.stderr
