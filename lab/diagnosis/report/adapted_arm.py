"""The adapted arm as it is written: its terms and provenance."""

from datetime import UTC, datetime
from pathlib import Path

from traverse.kinematics.arm_file.arm import Arm, arm_digest, parse_arm
from traverse.kinematics.arm_file.arm import Identification as Provenance
from traverse.lab.diagnosis.model.result import Diagnosis, Term
from traverse.lab.diagnosis.model.terms import has_epoch
from traverse.strict_toml.files import text_of
from traverse.strict_toml.problems import FileError, Problem
from traverse.strict_toml.writing import arm_text, write_atomically


def terms_without_epoch(diagnosis: Diagnosis) -> tuple[Term, ...]:
    """List accepted terms that cannot be written: bound to an unknown time.

    The moment that such an effect counts from is the campaign's start; where the
    campaign does not say when it began there is none.
    """
    return tuple(
        term
        for term in diagnosis.terms
        if term.effect is not None
        and term.accepted
        and not has_epoch(term.effect, diagnosis.campaign)
    )


def arm_with_provenance(diagnosis: Diagnosis, when: datetime | None = None) -> Arm:
    """Make the arm that is written."""
    arm, campaign = diagnosis.adapted, diagnosis.campaign
    effects = arm.effects
    if campaign.start_utc is None:
        nowhere = campaign.start
        effects = tuple(
            effect
            for effect in effects
            if has_epoch(effect, campaign) or effect.epoch_utc != nowhere
        )
    provenance = Provenance(
        sigma0=diagnosis.after.sigma0,
        redundancy=diagnosis.after.redundancy,
        date=(when or datetime.now(UTC)).replace(microsecond=0),
        campaign_digest=campaign.digest or None,
        design_digest=arm_digest(diagnosis.arm),
        parameters=diagnosis.after.network.parameters.free_names,
    )
    return arm.model_copy(update={"effects": effects, "identification": provenance})


def write_adapted(path: Path, arm: Arm, source: Path) -> None:
    """Write an arm file whole, with the comments of its source file.

    The source may be the file itself.

    Raises:
        FileError: The arm breaks a rule of arm files; an old file stays.
        OSError: A file cannot be read or written.
    """
    values = arm.model_dump(by_alias=True, exclude_unset=True)
    text = arm_text(values, text_of(source))
    if parse_arm(text, str(path)) != arm:
        problem = Problem("", "would not hold all values of this arm")
        raise FileError(str(path), [problem])
    write_atomically(path, text)
