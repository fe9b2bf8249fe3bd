"""XML signatures of certificates (XML-DSig, enveloped), by the library signxml."""

from base64 import b64decode
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from lxml import etree
from signxml.exceptions import SignXMLException
from signxml.signer import XMLSigner
from signxml.verifier import SignatureConfiguration, XMLVerifier

from traverse.strict_toml.files import bytes_of
from traverse.strict_toml.problems import FileError

_NAMESPACE = "http://www.w3.org/2000/09/xmldsig#"
SIGNATURE = f"{{{_NAMESPACE}}}Signature"
_X509 = f"{{{_NAMESPACE}}}X509Certificate"
_LEAST_RSA_BITS = 2048
_INVALID = (SignXMLException, UnsupportedAlgorithm, ValueError)


@dataclass(frozen=True, slots=True)
class SigningKey:
    """The private key of a laboratory, with the X.509 certificate of its public key."""

    key: ec.EllipticCurvePrivateKey | rsa.RSAPrivateKey
    certificate: x509.Certificate


def read_certificate(path: Path) -> x509.Certificate:
    """Read an X.509 certificate, PEM.

    Raises:
        FileError: It is none.
    """
    try:
        return x509.load_pem_x509_certificate(bytes_of(path))
    except ValueError as error:
        message = f"is no X.509 certificate in PEM form: {error}"
        raise FileError(path, message) from error


def read_signing_key(
    key: Path, certificate: Path, password: str | None, issued: date
) -> SigningKey:
    """Read a key and its certificate, which must belong together and be valid.

    Raises:
        FileError: One of them cannot be used, and why.
    """
    secret = password.encode() if password else None
    try:
        private = serialization.load_pem_private_key(bytes_of(key), secret)
    except (ValueError, TypeError) as error:
        message = (
            "is no private key in PEM form, or its password is not that of "
            f"TRAVERSE_KEY_PASSWORD: {error}"
        )
        raise FileError(key, message) from error
    is_usable = isinstance(private, ec.EllipticCurvePrivateKey) or (
        isinstance(private, rsa.RSAPrivateKey) and private.key_size >= _LEAST_RSA_BITS
    )
    if not is_usable:
        message = (
            f"is no ECDSA key, nor RSA with {_LEAST_RSA_BITS} bits or more; make one"
        )
        raise FileError(key, message)
    of_key = read_certificate(certificate)
    if of_key.public_key() != private.public_key():
        raise FileError(certificate, f"does not belong to the key {key}")
    if not _is_valid(of_key, issued):
        raise FileError(certificate, f"is {_validity(of_key)}, not on {issued}")
    return SigningKey(private, of_key)  # type: ignore[arg-type]  # of two kinds


def _validity(certificate: x509.Certificate) -> str:
    first, last = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    return f"valid from {first:%Y-%m-%d} to {last:%Y-%m-%d}"


def _is_valid(certificate: x509.Certificate, day: date) -> bool:
    first, last = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    return first.date() <= day <= last.date()


def signed(root: etree._Element, key: SigningKey) -> etree._Element:
    """Return the document with its signature as the last child of the root."""
    kind = "ecdsa" if isinstance(key.key, ec.EllipticCurvePrivateKey) else "rsa"
    signer = XMLSigner(signature_algorithm=f"{kind}-sha256")
    return signer.sign(root, key=key.key, cert=[key.certificate])


@dataclass(frozen=True, slots=True)
class Checked:
    """What a check of a certificate or its signature found.

    Attributes:
        problems: Everything that is altered, invalid or missing.
        notes: What was checked, and what could not be.
    """

    problems: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def checked_signature(
    root: etree._Element, issued: date, trusted: Sequence[x509.Certificate]
) -> Checked:
    """Check the signature of a document.

    Whoever is trusted is trusted as signer or as who issued the signer's certificate.
    Without anybody only the signature is checked, not whose it is.
    """
    signatures = root.findall(SIGNATURE)
    if not signatures and not trusted:
        return Checked(notes=("is not signed: who made it is not proved",))
    keys = [key for entry in signatures for key in entry.findall(f".//{_X509}")]
    if len(signatures) != 1 or len(keys) != 1:
        return Checked(("is not signed, or not once by one key",))
    try:
        of_signer = x509.load_der_x509_certificate(b64decode(keys[0].text or ""))
        _verify(root, of_signer)
        if not _is_valid(of_signer, issued):
            raise ValueError(
                f"its certificate is {_validity(of_signer)}, not on {issued}"
            )
        signer = _described(of_signer)
    except (*_INVALID, etree.LxmlError) as error:
        return Checked((f"was altered, or has no valid signature: {error}",))
    if not trusted:
        compare = "the signer was not compared: name whom you trust by --trust"
        return Checked(notes=(f"signed by {signer}", compare))
    if not any(_vouches(entry, of_signer) for entry in trusted):
        return Checked((f"was signed by one who is not trusted: {signer}",))
    return Checked(notes=(f"signed by {signer}, who is trusted",))


def _verify(root: etree._Element, of_signer: x509.Certificate) -> None:
    """Verify that the one signature is of the whole document.

    Raises:
        SignXMLException, ValueError: It is not.
    """
    # Nobody attests when it was signed: validity is that on the date of issue.
    expected = SignatureConfiguration(
        location="./",
        verification_time=of_signer.not_valid_after_utc,
        expect_references=1,
    )
    result = XMLVerifier().verify(root, x509_cert=of_signer, expect_config=expected)
    document = None if isinstance(result, list) else result.signed_xml
    if document is None or document.tag != root.tag:
        raise ValueError("something else in it is signed")


def _described(certificate: x509.Certificate) -> str:
    fingerprint = certificate.fingerprint(hashes.SHA256()).hex()
    name = certificate.subject.rfc4514_string()
    return f"{name}, certificate {_validity(certificate)}, SHA-256 {fingerprint}"


def _vouches(trusted: x509.Certificate, signer: x509.Certificate) -> bool:
    if trusted == signer:
        return True
    try:
        signer.verify_directly_issued_by(trusted)
        constraints = trusted.extensions.get_extension_for_class(x509.BasicConstraints)
    except (*_INVALID, TypeError, InvalidSignature, x509.ExtensionNotFound):
        return False
    return constraints.value.ca
