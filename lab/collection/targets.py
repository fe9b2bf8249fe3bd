"""What is wanted of a collection: every feature so often, or a plan step by step."""

from collections.abc import Iterator
from dataclasses import dataclass

from traverse.lab.campaign.campaign_file import CampaignFile
from traverse.lab.collection.plan import PlanFile
from traverse.strict_toml.problems import FileError, Problem, unknown_name_message


@dataclass(frozen=True, slots=True)
class Target:
    """Something to be touched so many times.

    Attributes:
        say: What to do, in a sentence; empty where the names are enough.
    """

    artefact: str
    feature: str
    kind: str
    wanted: int
    say: str = ""

    def __str__(self) -> str:
        return f"{self.artefact} {self.feature}".strip()


def targets_of(file: CampaignFile, wanted: int) -> tuple[Target, ...]:
    """What a campaign wants touched, each feature so many times."""
    return tuple(_targets(file, wanted))


def planned_targets(
    plan: PlanFile, file: CampaignFile, source: str
) -> tuple[Target, ...]:
    """Turn steps into targets, counted up: a feature may come again and again.

    Raises:
        FileError: Steps name what the campaign does not have.
    """
    artefacts = {artefact.id: artefact for artefact in file.artefacts}
    problems, targets = [], []
    counts: dict[tuple[str, str], int] = {}
    for index, step in enumerate(plan.steps):
        artefact = artefacts.get(step.artefact)
        if artefact is None:
            message = unknown_name_message("artefact", step.artefact, artefacts)
            problems.append(Problem(f"steps[{index}].artefact", message))
            continue
        if artefact.features and step.feature not in artefact.features:
            message = unknown_name_message("feature", step.feature, artefact.features)
            problems.append(Problem(f"steps[{index}].feature", message))
            continue
        key = (step.artefact, step.feature)
        counts[key] = counts.get(key, 0) + step.touches
        targets.append(Target(*key, artefact.kind, counts[key], step.say))
    if problems:
        raise FileError(source, problems)
    return tuple(targets)


def _targets(file: CampaignFile, wanted: int) -> Iterator[Target]:
    for artefact in file.artefacts:
        features = artefact.features or ("",)
        for feature in features:
            yield Target(artefact.id, feature, artefact.kind, wanted)
