"""Campaign and plan of an acceptance test, written for `traverse collect`."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from traverse.lab.acceptance.plan import Plan
from traverse.lab.campaign.campaign_file import read_campaign_file
from traverse.lab.collection.plan import PLAN, read_plan
from traverse.strict_toml.problems import FileError, Problem
from traverse.strict_toml.writing import write_atomically

CAMPAIGN = "campaign.toml"
_HEAD = """\
# What `traverse verify --plan {standard}` proposes to touch.
# Before collecting: put in the lengths, radii, uncertainties and expansion of YOUR
# certificates. Ids and features say which test a touch belongs to; keep them.
"""


def write_plan(plan: Plan, standard: str, folder: Path) -> dict[str, Any]:
    """Write campaign.toml and plan.toml; gives what they hold.

    Raises:
        FileError: A campaign is there already; it is not replaced.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in (CAMPAIGN, PLAN):
        if (folder / name).exists():
            told = "is there already; give another folder, or move it away"
            raise FileError(str(folder / name), [Problem("", told)])
    write_atomically(
        folder / CAMPAIGN, _HEAD.format(standard=standard) + campaign_text(plan)
    )
    write_atomically(folder / PLAN, plan_text(plan))
    read_campaign_file(folder / CAMPAIGN)
    read_plan(folder / PLAN)
    return {
        "folder": str(folder),
        "files": [CAMPAIGN, PLAN],
        "artefacts": len(plan.artefacts),
        "steps": len(plan.steps),
        "touches": sum(step.touches for step in plan.steps),
    }


def plan_words(report: Mapping[str, Any]) -> list[str]:
    """What was written, and what there is to do."""
    counts = [f"{report[what]} {what}" for what in ("artefacts", "steps", "touches")]
    folder = report["folder"]
    return [
        ", ".join(counts),
        f"wrote {folder}: {', '.join(report['files'])}",
        f"put your certificates into {CAMPAIGN}, then: traverse collect "
        f"{Path(folder) / CAMPAIGN} --arm ARM",
    ]


def campaign_text(plan: Plan) -> str:
    """The text of campaign.toml."""
    lines = ['schema = "traverse/campaign/1"', 'poses = "poses.csv"']
    for name, table in plan.artefacts.items():
        lines += ["", "[[artefacts]]", f'id = "{name}"']
        lines += _entries(table)
        for key, value in table.items():
            if isinstance(value, Mapping):
                lines += [f"[artefacts.{key}]", *_entries(value)]
    return "\n".join(lines) + "\n"


def plan_text(plan: Plan) -> str:
    """The text of plan.toml."""
    lines = [
        'schema = "traverse/collection-plan/1"',
        f"centre_mm = {list(plan.shoulder_mm)!r}",
        f"reach_mm = {plan.reach_mm!r}",
    ]
    for step in plan.steps:
        lines += [
            "",
            "[[steps]]",
            f'artefact = "{step.artefact}"',
            f'feature = "{step.feature}"',
            f"touches = {step.touches}",
            f'say = "{step.say}"',
        ]
    return "\n".join(lines) + "\n"


def _entries(table: Mapping[str, Any]) -> Iterator[str]:
    for key, value in table.items():
        if isinstance(value, Mapping):
            continue
        text = f'"{value}"' if isinstance(value, str) else repr(value)
        yield f"{key} = {text}"
