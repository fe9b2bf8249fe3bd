"""The certificate as a page, in one file with the raw data; and as lines of text."""

from collections.abc import Mapping
from typing import Any

from traverse.lab.acceptance.certificate.pictures import paintings
from traverse.lab.acceptance.certificate.values import SealedCertificate
from traverse.lab.report.figures import painted
from traverse.lab.report.templates import Words, page

_WIDTH_MM = 165.0
WORDS = Words("acceptance/certificate/words.jinja")


def figure_lines(values: Mapping[str, Any]) -> list[str]:
    """Say a certificate in lines.

    Args:
        values: The certificate.
    """
    return WORDS.lines("summary", values)


def certificate_page(certificate: SealedCertificate) -> str:
    """Make the page; the text is complete in itself."""
    values = certificate.values
    return page(
        "acceptance/certificate/page.jinja",
        {},
        values=values,
        words=WORDS,
        missing=[
            (one["name"], what) for one in values["missing"] for what in one["what"]
        ],
        files=certificate.files,
        pictures=painted(paintings(values), _WIDTH_MM),
    )
