"""Until when certificates are valid, and warnings before they end.

Python's `ssl` reads the dates of a peer's certificate, and not those of its own: of DER
(ITU-T X.690) it takes little to find them (RFC 5280, section 4.1).
"""

import re
import ssl
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

WARN_BEFORE = timedelta(days=14)
WARN_AGAIN = timedelta(days=1)
OF_BROKER = "the broker's certificate"

_PEM = re.compile(r"-----BEGIN CERTIFICATE-----.+?-----END CERTIFICATE-----", re.DOTALL)
_SEQUENCE, _UTC_TIME, _GENERALIZED_TIME, _VERSION = 0x30, 0x17, 0x18, 0xA0
_FORMATS = {_UTC_TIME: "%y%m%d%H%M%SZ", _GENERALIZED_TIME: "%Y%m%d%H%M%SZ"}
_CENTURY = 50  # years from here on are of the twentieth (RFC 5280, 4.1.2.5.1)


@dataclass(frozen=True, slots=True)
class EndWarning:
    """That a certificate has ended or will soon, and the remedy."""

    text: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.text}; {self.remedy}"


def warning_of_end(name: str, end: datetime, now: datetime) -> EndWarning | None:
    """Warn of a certificate that ends within `WARN_BEFORE`; None: it does not yet."""
    if end - now > WARN_BEFORE:
        return None
    verb = "ends" if end > now else "has ended"
    remedy = f"renew {name}"
    if name != OF_BROKER:
        remedy += (
            "; it is used from the next connection on, by the daemon at once after "
            "`systemctl reload`"
        )
    return EndWarning(
        f"{name} {verb} on {end:%Y-%m-%d %H:%M} UTC; after that the broker is not "
        "connected to again once the connection is lost",
        remedy,
    )


class CertificateWatch:
    """Warns of the certificates of a connection, of each once a day.

    Args:
        warn: called with warnings.
        utc: the time now.
    """

    def __init__(
        self,
        warn: Callable[[EndWarning], None],
        utc: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        self._warn, self._utc = warn, utc
        self._warned: dict[str, datetime] = {}

    def check(self, ends: Mapping[str, datetime]) -> None:
        """Look at the ends of certificates by their names; call often."""
        now = self._utc()
        for name, end in ends.items():
            warned = self._warned.get(name)
            if warned is not None and abs(now - warned) < WARN_AGAIN:
                continue
            if (warning := warning_of_end(name, end, now)) is not None:
                self._warned[name] = now
                self._warn(warning)


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
