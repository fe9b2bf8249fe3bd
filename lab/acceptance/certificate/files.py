"""Files of a verification: certificate.json, .html, .pdf, the data, and SHA256SUMS."""

import json
from pathlib import Path

from traverse.lab.acceptance.certificate.check import CERTIFICATE, DATA, PAGES
from traverse.lab.acceptance.certificate.page import certificate_page
from traverse.lab.acceptance.certificate.pdf import certificate_pdf
from traverse.lab.acceptance.certificate.values import SealedCertificate
from traverse.lab.report.provenance import sums_of, write_sums
from traverse.strict_toml.writing import write_atomically


def write_certificate(certificate: SealedCertificate, folder: Path) -> None:
    """Write everything into a folder, which is made if need be.

    The JSON is written after the files that it lists, and the digests of all last.

    Raises:
        OSError: The folder cannot be written.
    """
    data = folder / DATA
    data.mkdir(parents=True, exist_ok=True)
    for name, content in certificate.files.items():
        (data / name).write_bytes(content)
    values = certificate.values
    lines = json.dumps(values, indent=1, allow_nan=False, ensure_ascii=False)
    text = f"{lines}\n".encode()
    write_atomically(folder / "certificate.html", certificate_page(certificate))
    document = certificate_pdf(values, {**certificate.files, CERTIFICATE: text})
    (folder / "certificate.pdf").write_bytes(document)
    write_atomically(folder / CERTIFICATE, text.decode())
    names = (*PAGES, *(f"{DATA}/{name}" for name in certificate.files))
    write_sums(folder, sums_of(folder, names))
