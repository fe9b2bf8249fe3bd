"""Until when certificates are valid.

Python's `ssl` reads the dates of a peer's certificate, and not those of its own: of DER
(ITU-T X.690) it takes little to find them (RFC 5280, section 4.1).
"""

import re
import ssl
from collections.abc import Iterator
from datetime import UTC, datetime

_PEM = re.compile(r"-----BEGIN CERTIFICATE-----.+?-----END CERTIFICATE-----", re.DOTALL)
_SEQUENCE, _UTC_TIME, _GENERALIZED_TIME, _VERSION = 0x30, 0x17, 0x18, 0xA0
_FORMATS = {_UTC_TIME: "%y%m%d%H%M%SZ", _GENERALIZED_TIME: "%Y%m%d%H%M%SZ"}
_CENTURY = 50  # years from here on are of the twentieth (RFC 5280, 4.1.2.5.1)


def ends_of_pem(content: bytes) -> list[datetime]:
    """Return when each certificate of a file ends; what cannot be read is left out."""
    ends = []
    for text in _PEM.findall(content.decode("ascii", "replace")):
        try:
            ends.append(_end_of_der(ssl.PEM_cert_to_DER_cert(text)))
        except (ValueError, IndexError, KeyError):
            continue
    return ends


def end_of_peer(tls: ssl.SSLObject | None) -> datetime | None:
    """Return when the certificate of a connection's peer ends; None without TLS."""
    certificate = None if tls is None else tls.getpeercert()
    if not certificate or "notAfter" not in certificate:
        return None
    end_s = ssl.cert_time_to_seconds(str(certificate["notAfter"]))
    return datetime.fromtimestamp(end_s, UTC)


def _end_of_der(der: bytes) -> datetime:
    """Return `notAfter` of a certificate; raises ValueError, IndexError, KeyError."""
    ((_, certificate),) = _elements(der)
    _, signed = next(_elements(certificate))
    fields = [element for element in _elements(signed) if element[0] != _VERSION]
    # serialNumber, signature, issuer, validity
    _, (kind, value) = _elements(fields[3][1])
    end = datetime.strptime(value.decode("ascii"), _FORMATS[kind]).replace(tzinfo=UTC)
    if kind == _UTC_TIME:
        year = end.year % 100
        end = end.replace(year=year + (1900 if year >= _CENTURY else 2000))
    return end


def _elements(der: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield tags and contents of successive elements."""
    place = 0
    while place < len(der):
        tag, length = der[place], der[place + 1]
        place += 2
        if length & 0x80:
            n = length & 0x7F
            length = int.from_bytes(der[place : place + n])
            place += n
        if place + length > len(der):
            raise ValueError("an element is longer than what it is in")
        yield tag, der[place : place + length]
        place += length
