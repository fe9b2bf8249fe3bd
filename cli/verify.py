"""`traverse verify`: acceptance figures, their plan, and checking certificates."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from traverse.cli.certify import Schemas
from traverse.cli.common.options import Json, Operator, campaign_folder
from traverse.cli.common.refusals import (
    FAILED,
    check_inputs,
    print_report,
    refusals,
    refuse,
)
from traverse.strict_toml.files import bytes_of

if TYPE_CHECKING:
    from traverse.kinematics.arm_file.arm import Arm
    from traverse.lab.acceptance.certificate.values import SealedCertificate
    from traverse.lab.acceptance.limits import Limits


def verify(
    data: Annotated[Path | None, typer.Argument(callback=campaign_folder)] = None,
    *,
    standard: str | None = None,
    arm: Path | None = None,
    limits: Path | None = None,
    as_found: Path | None = None,
    previous: Path | None = None,
    laboratory: Path | None = None,
    out: Annotated[Path | None, typer.Option("--out", "-o")] = None,
    plan: str | None = None,
    bidirectional: bool = False,
    check: Path | None = None,
    trust: list[Path] | None = None,
    schemas: Schemas = None,
    operator: Operator = None,
    as_json: Json = False,
) -> None:
    """Decide on conformity by the figures of a standard.

    Writes certificate.json, .html and .pdf with the raw data into --out.
    Exit status 1: something is missing, a statement too, or not everything is accepted.

    Args:
        data: Folder with campaign.toml, or a recording (.mcap).
        standard: iso10360-12, iso10360-8 (scanning), asme-b89.4.22 or vdi2617-9.
        arm: The arm file; a recording has its own.
        limits: Maximum permissible errors and how to decide, TOML.
        as_found: The arm file before it was adjusted; the same touches are computed
            with it, too.
        previous: certificate.json of the arm's previous certificate, or its folder.
        laboratory: Who certifies, for whom and under which number, TOML; as of
            `traverse certify`.
        out: Folder for the certificate.
        plan: Write what to touch for a standard into --out instead.
        bidirectional: With --plan iso10360-12 or iso10360-8: E_BI too.
        check: Check a certificate, or its folder.
        trust: With --check: X.509 certificate of a signer, or of who vouches for it,
            PEM. Repeatable; else the signer is shown, not judged.
    """
    others = limits, as_found, previous, laboratory
    check_inputs(data, arm, *others, check, schemas, *(trust or ()))
    with refusals():
        if check is not None:
            _checked(check, trust or [], schemas, as_json=as_json)
            return
        if plan is not None:
            known = _known(plan, "--plan")
            report = _planned(known, arm, out, bidirectional=bidirectional)
            from traverse.lab.acceptance.plan import plan_words

            print_report(report, plan_words(report), as_json=as_json)
            return
        if data is None or standard is None:
            name = "DATA" if data is None else "--standard"
            refuse(f"{name} missing; or give --plan STANDARD, or --check")
        known = _known(standard, "--standard")
        certificate = _certificate(data, known, arm, others, operator)
        values = certificate.values
        if out is not None:
            from traverse.lab.acceptance.certificate.files import write_certificate

            write_certificate(certificate, out)
    from traverse.lab.acceptance.certificate.page import WORDS

    wrote = f"wrote {out}: certificate.json, .html, .pdf, data"
    lines = [*WORDS.lines("summary", values), *([] if out is None else [wrote])]
    print_report(values, lines, as_json=as_json)
    if values["verdict"] != "accept":
        raise typer.Exit(FAILED)


def _known(standard: str, option: str) -> str:
    from traverse.lab.acceptance.standards import STANDARDS

    if standard not in STANDARDS:
        names = ", ".join(STANDARDS)
        refuse(f"{option}: no standard {standard!r}; there are: {names}")
    return standard


def _certificate(
    data: Path,
    standard: str,
    arm_file: Path | None,
    others: Sequence[Path | None],
    computed_by: str | None,
) -> "SealedCertificate":
    """Compute it; the others are limits, as found, previous and laboratory."""
    from traverse.lab.acceptance.administration import administration_of
    from traverse.lab.acceptance.certificate.check import (
        ARM,
        CERTIFICATE,
        LABORATORY,
        LIMITS,
    )
    from traverse.lab.acceptance.certificate.comparison import (
        AS_FOUND,
        PREVIOUS,
        read_before,
    )
    from traverse.lab.acceptance.certificate.values import SealedCertificate
    from traverse.lab.acceptance.laboratory import Laboratory
    from traverse.lab.acceptance.limits import NO_LIMITS, Limits
    from traverse.lab.acceptance.standards import verified
    from traverse.lab.measured_points.reading import files_read, read_by_tool
    from traverse.lab.report import provenance as sources
    from traverse.strict_toml.reader import read_strict

    limits, as_found, previous, laboratory = others
    arm, text = _arm(data, arm_file)
    permitted = NO_LIMITS
    if limits is not None:
        permitted = read_strict(limits, Limits)
    certifying = None
    if laboratory is not None:
        certifying = read_strict(laboratory, Laboratory)
    _ask_before(data, standard, arm, permitted)
    covariance = _covariance_beside(arm, arm_file)
    measured = read_by_tool(data, arm, None if covariance is None else arm_file)
    files = {path.name: bytes_of(path) for path in files_read(data)}
    digest = sources.digest_of_files(files_read(data))
    source = sources.ReportSource(data.resolve().name, digest)
    files[ARM] = text
    reason = measured[0].errors_unknown
    if covariance is not None and reason is None:
        files[covariance.name] = bytes_of(covariance)
    elif covariance is not None:
        typer.echo(f"lengths are not predicted by the arm file: {reason}", err=True)
    if previous is not None and not previous.is_file():
        previous /= CERTIFICATE  # its folder is named
    before = read_before(
        data, standard, permitted, arm, as_found=as_found, previous=previous
    )
    kept = {LIMITS: limits, AS_FOUND: as_found, PREVIOUS: previous}
    kept[LABORATORY] = laboratory
    files |= {name: bytes_of(path) for name, path in kept.items() if path is not None}
    return SealedCertificate(
        verified(measured, standard, permitted),
        arm,
        permitted,
        files,
        administration_of(measured, arm, permitted),
        sources.report_provenance(source, computed_by),
        before,
        certifying,
    )


def _ask_before(data: Path, standard: str, arm: "Arm", limits: "Limits") -> None:
    """Name the missing parts of a verdict while nothing has been measured."""
    from traverse.lab.acceptance.statements import absent_before
    from traverse.lab.campaign.campaign_file import read_campaign_file

    if data.suffix == ".mcap":
        return
    file = read_campaign_file(data / "campaign.toml")
    if not (data / file.poses).exists():
        for statement in absent_before(standard, file, arm, limits):
            text = f"a verdict lacks {statement.subject}: give {statement.where}"
            typer.echo(text, err=True)


def _covariance_beside(arm: "Arm", file: Path | None) -> Path | None:
    """The file of the arm's covariance; None where it is not beside the arm file."""
    known = arm.identification
    if file is None or known is None or known.covariance_file is None:
        return None
    covariance_file = file.with_name(Path(known.covariance_file).name)
    same = covariance_file == file.parent / known.covariance_file
    return covariance_file if same and covariance_file.is_file() else None


def _arm(data: Path, file: Path | None) -> "tuple[Arm, bytes]":
    from traverse.kinematics.arm_file.arm import parse_arm, read_arm

    if file is not None:
        return read_arm(file), bytes_of(file)
    if data.suffix != ".mcap":
        refuse("--arm missing; the arm file with which it was measured")
    from traverse.recording.reader import read_recording

    text = read_recording(data).arm_text
    return parse_arm(text, f"{data}: arm.toml"), text.encode()


def _planned(
    standard: str, arm_file: Path | None, out: Path | None, *, bidirectional: bool
) -> dict[str, Any]:
    from traverse.kinematics.arm_file.arm import read_arm
    from traverse.lab.acceptance.plan import plan_of, write_plan

    if arm_file is None or out is None:
        refuse("--plan needs --arm and --out")
    plan = plan_of(standard, read_arm(arm_file), bidirectional=bidirectional)
    return write_plan(plan, standard, out)


def _checked(
    path: Path, trust: list[Path], schemas: Path | None, *, as_json: bool
) -> None:
    from traverse.lab.acceptance.certificate.check import (
        certificate_problems,
    )

    folder = path if path.is_dir() else path.parent
    if (folder / "dcc.xml").is_file():
        from traverse.lab.certificates.certificate import checked_certificate
        from traverse.lab.certificates.signature import read_certificate

        trusted = [read_certificate(trusted_file) for trusted_file in trust]
        check = checked_certificate(folder, trusted, schemas)
        problems, notes = list(check.problems), list(check.notes)
    elif trust:
        refuse(f"--trust: {folder} has no dcc.xml; `traverse certify` signs")
    else:
        problems = certificate_problems(path)
        notes = []
    if not problems:
        notes.insert(0, "digests agree, and the figures follow from the data")
    lines = [f"{path}: {line}" for line in (*problems, *notes)]
    report = {"certificate": str(path), "problems": problems, "notes": notes}
    print_report(report, lines, as_json=as_json)
    if problems:
        raise typer.Exit(FAILED)
