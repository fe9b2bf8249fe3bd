"""Folders of results, laboratories and keys, made for tests of certificates."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
)
from cryptography.x509.oid import NameOID

LABORATORY = """\
schema = "traverse/laboratory/1"
number = "2026-0417"
issued = 2026-11-23

[laboratory]
name = "Example & Daughters <calibration>"
code = "D-K-00000-01-00"
street = "Messweg 1"
city = "Braunschweig"
country = "DE"

[customer]
name = "Łódź Arms"
city = "Łódź"
country = "PL"

[[persons]]
name = "C. Gauss"
role = "head"
main_signer = true

[arm]
manufacturer = "own make"
serial_number = "SN 7"
"""

DAY = datetime(2026, 11, 23, tzinfo=UTC)


@dataclass
class Issued:
    """A key, and the certificate of it."""

    key: ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey
    certificate: x509.Certificate

    def write(self, folder: Path, name: str) -> tuple[Path, Path]:
        """Write both as PEM files."""
        key, certificate = folder / f"{name}.key", folder / f"{name}.pem"
        key.write_bytes(
            self.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
        )
        certificate.write_bytes(self.certificate.public_bytes(Encoding.PEM))
        return key, certificate


def issued(
    name: str,
    by: Issued | None = None,
    *,
    days: tuple[int, int] = (-10, 1000),
    is_rsa: bool = False,
    is_authority: bool = False,
) -> Issued:
    """Make a key with a certificate: of itself, or issued by another."""
    key = (
        rsa.generate_private_key(65537, 2048)
        if is_rsa
        else ec.generate_private_key(ec.SECP256R1())
    )
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    certificate = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(by.certificate.subject if by else subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(DAY + timedelta(days=days[0]))
        .not_valid_after(DAY + timedelta(days=days[1]))
        .add_extension(x509.BasicConstraints(is_authority, None), critical=True)
        .sign(by.key if by else key, hashes.SHA256())
    )
    return Issued(key, certificate)
