"""Many campaigns of one design identified or diagnosed, each as its command would.

What becomes of a campaign depends neither on who computes it nor on the others: its
inputs travel to a worker, and the files that were written come back.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory

from traverse.fleet.workers import WorkerDiedError, Workers, drained
from traverse.kinematics.arm_file.arm import Arm
from traverse.lab.adjustment import IdentificationError
from traverse.lab.campaign.campaign import Campaign
from traverse.lab.diagnosis.model.result import DiagnosisOptions
from traverse.lab.diagnosis.report.outcome import outcome_of as outcome_of_diagnosis
from traverse.lab.identification.identify import Options
from traverse.lab.identification.results.outcome import outcome_of
from traverse.lab.outcomes.base import State
from traverse.lab.report.provenance import ReportProvenance
from traverse.lab.runs.diagnosis import diagnosed, write_diagnosed
from traverse.lab.runs.identification import identified, write_identified
from traverse.lab.runs.inputs import BreakdownError, read_inputs
from traverse.strict_toml.files import bytes_of, locked_folder
from traverse.strict_toml.problems import FileError
from traverse.strict_toml.writing import replacing

ARM = "arm.toml"
_VERDICT = "verdict: "


@dataclass(frozen=True, slots=True)
class Request:
    """Common settings of all campaigns.

    Attributes:
        arm: File of the design, or a folder of earlier results, NAME/arm.toml each.
        options: Of an identification or of a diagnosis.
        out: Folder for the results, NAME/ each.
        operator, date: Who computes, and when, for the reports; default now.
    """

    arm: Path
    family: Path | None
    prior: tuple[str, ...]
    options: Options | DiagnosisOptions
    out: Path
    operator: str | None = None
    date: datetime | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """Everything that the results of a campaign depend on; the arm file as it is."""

    name: str
    campaign: Campaign
    arm: Arm
    arm_file: bytes
    options: Options | DiagnosisOptions
    provenance: ReportProvenance


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a campaign.

    Attributes:
        verdict: In words, or why there is none.
        good: Whether the command for this campaign alone would exit with 0.
        files: Written ones, by name.
    """

    name: str
    verdict: str
    failed: bool = False
    good: bool = False
    files: tuple[tuple[str, bytes], ...] = ()


def results_of(folder: Path, out: Path) -> Path:
    return out / folder.resolve().name


def check_request(folders: Sequence[Path], request: Request) -> None:
    """Refuse campaigns that would write into one place, or over something.

    Raises:
        ValueError: Two are called the same, or there are results already.
    """
    results = [results_of(folder, request.out) for folder in folders]
    for path in results:
        if results.count(path) > 1:
            raise ValueError(
                f"{results.count(path)} campaigns are called {path.name}; results are "
                "kept by the names of their paths: rename them"
            )
        if path.exists():
            raise ValueError(
                f"{path} is there; name another --out, or run those that have no "
                "results yet: --rest"
            )


def run_campaigns(
    folders: Sequence[Path], request: Request, workers: Workers
) -> Iterator[Outcome]:
    """Run campaigns, write their results, and yield their outcomes as they end.

    A campaign that cannot be read fails by itself.

    Raises:
        WorkersError: The cluster cannot be used, or went away.
        OSError: A result cannot be written, or another program writes into the folder.
    """
    date, unread = request.date or datetime.now(UTC), deque[Outcome]()

    def tasks() -> Iterator[Task]:
        for folder in folders:
            name = folder.resolve().name
            try:
                yield _task(name, folder, request, date)
            except (OSError, FileError) as error:
                unread.append(Outcome(name, str(error), failed=True))

    request.out.mkdir(parents=True, exist_ok=True)
    with locked_folder(request.out, "writes its results into it"):
        for task, outcome in workers.each(run_task, tasks()):
            yield from drained(unread)
            if isinstance(outcome, WorkerDiedError):
                yield Outcome(task.name, str(outcome), failed=True)
                continue
            if outcome.files:
                _write(outcome, request.out)
            yield outcome
        yield from drained(unread)


def _write(outcome: Outcome, out: Path) -> None:
    """Write a folder of results, which is there whole or not at all."""
    with TemporaryDirectory(prefix=f".{outcome.name}.", dir=out) as folder:
        fresh = Path(folder) / outcome.name
        fresh.mkdir()
        for name, content in outcome.files:
            with replacing(fresh / name) as file:
                file.write(content)
        fresh.rename(out / outcome.name)


def _task(name: str, folder: Path, request: Request, date: datetime) -> Task:
    arm_file = request.arm
    if arm_file.is_dir():
        arm_file = arm_file / name / ARM
    arm, campaign = read_inputs(folder, arm_file, request.family, request.prior)
    provenance = campaign.provenance(request.operator, date)
    content = bytes_of(arm_file)
    return Task(name, campaign, arm, content, request.options, provenance)


def run_task(task: Task) -> Outcome:
    """Run a campaign on this machine, without leaving files there."""
    with TemporaryDirectory(prefix="traverse-") as folder:
        arm_file, out = Path(folder) / ARM, Path(folder) / "results"
        arm_file.write_bytes(task.arm_file)
        try:
            lines, good = _lines(task, arm_file, out)
        except (IdentificationError, BreakdownError) as error:
            return Outcome(task.name, str(error), failed=True)
        verdict = next(line for line in lines if _VERDICT in line)
        files = [(path.name, path.read_bytes()) for path in sorted(out.iterdir())]
        return Outcome(
            task.name, verdict.partition(_VERDICT)[2], good=good, files=tuple(files)
        )


def _lines(task: Task, arm_file: Path, out: Path) -> tuple[list[str], bool]:
    if isinstance(task.options, DiagnosisOptions):
        diagnosis = diagnosed(task.campaign, task.arm, task.options)
        lines = write_diagnosed(diagnosis, arm_file, out, task.provenance)
        state = outcome_of_diagnosis(diagnosis[0]).state
    else:
        result = identified(task.campaign, task.arm, task.options)
        lines = write_identified(result, out, task.provenance)
        state = outcome_of(result).outcome.state
    return lines, state is not State.BAD
