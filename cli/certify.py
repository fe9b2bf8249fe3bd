"""`traverse certify`: a digital calibration certificate from results."""

import os
from pathlib import Path
from typing import Annotated

import typer

from traverse.cli.common.options import Json, campaign_folder
from traverse.cli.common.refusals import (
    check_inputs,
    print_report,
    refusals,
    refuse,
)

KEY_PASSWORD_VARIABLE = "TRAVERSE_KEY_PASSWORD"
Schemas = Annotated[
    Path | None,
    typer.Option(
        envvar="TRAVERSE_SCHEMAS",
        help="Folder with the standard's own schema, dcc.xsd and what it imports.",
        exists=True,
        file_okay=False,
    ),
]


def certify(
    results: Path,
    *,
    laboratory: Annotated[Path, typer.Option(dir_okay=False)],
    campaign: Annotated[Path | None, typer.Option(callback=campaign_folder)] = None,
    arm: Path | None = None,
    key: Path | None = None,
    certificate: Path | None = None,
    schemas: Schemas = None,
    as_json: Json = False,
) -> None:
    """Make a digital calibration certificate.

    DCC 3.3.0, signed where a key is given. Computes every figure again from the raw
    data first. Writes dcc.xml, the raw data of an identification, and SHA256SUMS into
    the folder.

    Args:
        results: Folder of `traverse verify` or `identify`.
        laboratory: Who certifies, for whom, TOML.
        campaign: The source of an identification, at the first certificate.
        arm: Of an identification: the arm file that it began with.
        key: Private key to sign with, PEM.
        certificate: X.509 certificate of the key, PEM.
    """
    check_inputs(results, laboratory, campaign, arm, key, certificate)
    with refusals():
        from traverse.lab.acceptance.laboratory import Laboratory
        from traverse.lab.certificates.certificate import certify as made
        from traverse.lab.certificates.certificate import issue_date
        from traverse.lab.certificates.evidence import add_data
        from traverse.lab.certificates.signature import read_signing_key
        from traverse.strict_toml.reader import read_strict

        if (campaign is None) != (arm is None):
            refuse("--campaign and --arm belong together; give both")
        if (key is None) != (certificate is None):
            refuse("--key and --certificate belong together; give both")
        issued = issue_date(read_strict(laboratory, Laboratory))
        signing = None
        if key is not None and certificate is not None:
            password = os.environ.get(KEY_PASSWORD_VARIABLE)
            signing = read_signing_key(key, certificate, password, issued)
        if campaign is not None and arm is not None:
            add_data(results, campaign, arm)
        path = made(results, laboratory, signing, schemas)
        report = {
            "certificate": str(path),
            "issued": issued,
            "signed": signing is not None,
            "schema": "given" if schemas else "own part of DCC 3.3.0",
        }
        lines = [
            f"wrote {path}: "
            + ("signed" if signing else "not signed, --key and --certificate sign it"),
            "every figure was computed again from the raw data",
            f"keeps to {schemas / 'dcc.xsd'}"
            if schemas
            else "keeps to the part of DCC 3.3.0 that Traverse uses; --schemas takes "
            "the standard's own schema",
        ]
        print_report(report, lines, as_json=as_json)
