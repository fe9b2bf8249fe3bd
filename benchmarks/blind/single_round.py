"""One round of the blind test: hide an effect, diagnose, reveal it."""

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from benchmarks.blind.round import Case, Scenario, find, hide
from benchmarks.blind.score import Score, scored
from benchmarks.proofs.conditions import demo_arm
from traverse.kinematics.arm_file.arm import Arm, read_arm
from traverse.lab.diagnosis.model.result import Diagnosis
from traverse.lab.diagnosis.report.files import summary_lines, write_diagnosis
from traverse.simulator.campaigns import UnreachableError, write_campaign
from traverse.strict_toml.problems import FileError
from traverse.strict_toml.writing import write_atomically


def round_lines(case: Case, diagnosis: Diagnosis, score: Score) -> list[str]:
    lines = summary_lines(diagnosis)
    for hidden in hidden_table(case):
        keys = ", ".join(f"{key} = {value}" for key, value in hidden["keys"].items())
        lines.append(f"hidden: {hidden['name']}: {keys}")
    if not case.hidden:
        lines.append("hidden: nothing")
    return [*lines, f"score: {score_in_words(case, score)}"]


def round_json(case: Case, diagnosis: Diagnosis, score: Score) -> dict[str, Any]:
    return {
        "seed": case.seed,
        "size": case.scenario.size,
        "hidden": hidden_table(case),
        "verdict": diagnosis.verdict,
        "found": [
            {
                "name": term.candidate.name,
                "status": term.status,
                "alternatives": [o.candidate.name for o in term.alternatives],
            }
            for term in diagnosis.terms
        ],
        "score": asdict(score),
        "in_words": score_in_words(case, score),
    }


def hidden_table(case: Case) -> list[dict[str, Any]]:
    """Return the hidden effects, in the keys of an arm file."""
    return [
        {
            "name": " ".join(str(p) for p in truth.identity if p is not None),
            "keys": {key: _shown(value) for key, value in effect.keys.items()},
        }
        for truth, effect in zip(case.truths, case.hidden, strict=True)
    ]


def score_in_words(case: Case, score: Score) -> str:
    if not case.hidden:
        return "a false alarm" if score.detected else "right: nothing was hidden"
    if not score.detected:
        return "missed"
    if case.scenario.outside:
        return _outside(score)
    return _inside(len(case.hidden), score)


def _inside(n: int, score: Score) -> str:
    if score.all_exact:
        return "found by its right name" if n == 1 else "all found by their right names"
    if score.n_matched:
        spurious = f", and {score.n_spurious} more" if score.n_spurious else ""
        return f"{score.n_matched} of {n} found by their right names{spurious}"
    if score.in_set:
        return "not the first name, but among those that cannot be excluded"
    return "seen, at the right joint" if score.right_joint else "seen, but not found"


def _outside(score: Score) -> str:
    if score.confident_wrong:
        return "wrong: it was given a name, and it has none"
    where = "at the right joint" if score.right_joint else "at another joint"
    return f"{'called unknown' if score.unknown else 'left open'}, {where}"


def _shown(value: object) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(_shown(part) for part in value) + "]"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


REFUSED = 2
_MOST_EFFECTS = 3

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.command()
def single_round(
    *,
    seed: Annotated[int, typer.Option(help="Of everything that is drawn.", min=0)],
    size: Annotated[
        float,
        typer.Option(
            help="Of each effect: sqrt(lambda), about its standard deviations.",
            min=0.1,
        ),
    ] = 10.0,
    effects: Annotated[
        int, typer.Option(help="How many to hide.", min=0, max=_MOST_EFFECTS)
    ] = 1,
    outside: Annotated[
        bool, typer.Option("--outside", help="Hide what no arm file can name.")
    ] = False,
    arm: Annotated[
        Path | None,
        typer.Option("--arm", help="Arm file; default: that of the demonstration."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder for the diagnosis and its report."),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Report as JSON on standard output.")
    ] = False,
) -> None:
    """Hide an effect in a simulated campaign, let diagnosis find it, and score it.

    Hidden effects are revealed only at the end. Exit status 0, whatever was found.
    """
    arm_in_file = _arm(arm)
    scenario = Scenario("blind", effects, size, outside=outside)
    try:
        case = hide(arm_in_file, scenario, seed)
    except UnreachableError as error:
        _refuse(f"this arm cannot touch what is measured: {error}")
    progress = _show_progress if sys.stderr.isatty() else None
    diagnosis = find(case, progress, details=out is not None)
    score = scored(case.truths, diagnosis)
    if out is not None:
        _write(case, diagnosis, out)
    if as_json:
        typer.echo(json.dumps(round_json(case, diagnosis, score), indent=1))
    else:
        typer.echo("\n".join(round_lines(case, diagnosis, score)))


def _arm(path: Path | None) -> Arm:
    try:
        return demo_arm() if path is None else read_arm(path)
    except FileError as error:
        _refuse(str(error))


def _write(case: Case, diagnosis: Diagnosis, out: Path) -> None:
    folder = out / "campaign"
    write_campaign(folder, case.simulated, case.arm)
    text = json.dumps({"hidden": hidden_table(case)}, indent=1) + "\n"
    write_atomically(folder / "truth" / "hidden.json", text)
    write_diagnosis(out, diagnosis, folder / "arm.toml")


def _show_progress(stage: str, share: float) -> None:
    typer.echo(f"{share:4.0%} {stage}", err=True)


def _refuse(message: str) -> NoReturn:
    typer.echo(message, err=True)
    raise typer.Exit(REFUSED)


if __name__ == "__main__":
    app(prog_name="python -m benchmarks.blind.single_round")
