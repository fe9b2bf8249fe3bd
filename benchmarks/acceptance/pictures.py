"""The pictures of docs/acceptance.md, from results of `benchmarks.acceptance`."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.acceptance import arms, rates
from traverse.kinematics.arm_file.arm import read_arm
from traverse.lab.acceptance.administration import administration_of
from traverse.lab.acceptance.certificate.pictures import paintings
from traverse.lab.acceptance.certificate.values import SealedCertificate
from traverse.lab.acceptance.limits import Limits
from traverse.lab.acceptance.standards import verified
from traverse.lab.measured_points.reading import read_measured
from traverse.lab.report.figures import (
    BLUE,
    GREY,
    ORANGE,
    VERMILION,
    picture,
)
from traverse.lab.report.provenance import ReportSource, report_provenance
from traverse.simulator.campaigns import write_campaign
from traverse.simulator.campaigns.acceptance.poses import (
    acceptance_poses,
    drawn_acceptance,
)

SCHEMA = "traverse/acceptance-limits/1"
EXAMPLE_MPE = {
    "p_size_mm": 0.012,
    "p_form_mm": 0.030,
    "l_dia_mm": 0.045,
    "e_uni_mm": 0.0245,
}
_N_BINS = 12
_LABELS = {"p_size": "P_SIZE", "e_uni": "E_UNI"}


def paint(tested: Sequence[arms.Tested], folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    truth = picture(165.0, 75.0, lambda figure: _truth(tested, figure))
    (folder / "acceptance-truth.png").write_bytes(truth)
    decisions = picture(165.0, 82.0, lambda figure: _decisions(tested, figure))
    (folder / "acceptance-decisions.png").write_bytes(decisions)
    _, height_mm, painted = list(paintings(example()))[1]
    (folder / "acceptance-example.png").write_bytes(picture(165.0, height_mm, painted))


def example() -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as name:
        folder, arm = Path(name), read_arm(arms.ARM)
        poses = acceptance_poses(arm, arms.STANDARD, seed=1)
        write_campaign(folder, drawn_acceptance(poses, seed=1), arm)
        limits = Limits.model_validate({"schema": SCHEMA, "mpe": EXAMPLE_MPE})
        measured = read_measured(folder, arm)
        return SealedCertificate(
            verified([measured], arms.STANDARD, limits),
            arm,
            limits,
            {},
            administration_of([measured], arm, limits),
            report_provenance(ReportSource("example", "")),
        ).values


def _truth(tested: Sequence[arms.Tested], figure: Figure) -> None:
    panels = figure.subplots(1, 2)
    for axes, key in zip(panels, arms.FIGURES, strict=True):
        true = 1e3 * np.array([arm.true_mm[key] for arm in tested])
        measured = 1e3 * np.array([arm.found_mm[key] for arm in tested])
        limits = 1e3 * rates.limits_mm(tested, key)
        wrong = (true <= limits) != (measured <= limits)
        axes.plot(true[~wrong], measured[~wrong], ".", markersize=2.5, color=BLUE)
        axes.plot(true[wrong], measured[wrong], "x", markersize=3.5, color=VERMILION)
        axes.axline((float(true.mean()),) * 2, slope=1.0, color=GREY, linewidth=0.8)
        axes.set_title(f"{_LABELS[key]}; crosses: wrong without guard band")
        axes.set_xlabel("with exact standards [µm]")
        axes.set_ylabel("as measured [µm]")


def _decisions(tested: Sequence[arms.Tested], figure: Figure) -> None:
    panels = figure.subplots(1, 2, sharey=True)
    for axes, key in zip(panels, arms.FIGURES, strict=True):
        true_mm = np.array([arm.true_mm[key] for arm in tested])
        standard_mm = np.array([arm.standard_mm[key] for arm in tested])
        off_u = (true_mm - rates.limits_mm(tested, key)) / standard_mm
        edges = np.linspace(-arms.NEAR_U, arms.NEAR_U, _N_BINS + 1)
        middles = 0.5 * (edges[1:] + edges[:-1])
        bins = np.digitize(off_u, edges) - 1
        for rule, verdict, colour, style, label in (
            ("simple", "accept", GREY, "--", "accepted, simple"),
            ("1.65", "accept", BLUE, "-", "accepted, guard band 1.65 u"),
            ("1.65", "neither", ORANGE, "-", "neither"),
            ("1.65", "reject", VERMILION, "-", "rejected, guard band 1.65 u"),
        ):
            hit = rates.verdicts(tested, key, rule) == verdict
            shares = [
                100.0 * float(np.mean(hit[bins == n])) if np.any(bins == n) else np.nan
                for n in range(_N_BINS)
            ]
            axes.plot(
                middles, shares, style, color=colour, label=label, marker="o", ms=2.5
            )
        axes.axvline(0.0, color="black", linewidth=0.8)
        axes.set_title(_LABELS[key])
        axes.set_xlabel("true figure less limit, in u")
    panels[0].set_ylabel("arms [%]")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
