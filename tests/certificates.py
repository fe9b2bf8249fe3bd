import subprocess
from dataclasses import dataclass
from pathlib import Path

from tests.running import run_program

CURVE = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")


@dataclass(frozen=True)
class Pair:
    certificate: Path
    key: Path


def openssl(*arguments: str | Path) -> None:
    subprocess.run(
        ["openssl", *map(str, arguments)], check=True, capture_output=True, timeout=30
    )


def expired() -> tuple[str, ...]:
    """Options for a certificate of the past, which differ between versions."""
    ran = run_program("openssl", "version")
    major, minor, *_ = ran.stdout.split()[1].split(".")
    if (int(major), int(minor)) < (3, 4):
        return ("-days", "-1")
    return ("-not_before", "20200101000000Z", "-not_after", "20200102000000Z")


class Authority:
    """Signs certificates; files are in a folder, by name.

    Args:
        folder: where files go.
        name: of the authority.
    """

    def __init__(self, folder: Path, name: str = "authority") -> None:
        self._folder = folder
        self.certificate = folder / f"{name}.crt"
        self._key = folder / f"{name}.key"
        to = ("-keyout", self._key, "-out", self.certificate)
        use = ("-addext", "keyUsage=critical,keyCertSign,cRLSign")
        openssl("req", "-x509", *CURVE, "-days", "2", "-subj", f"/CN={name}", *use, *to)

    def sign(self, name: str, names: str = "", days: int = 2, file: str = "") -> Pair:
        """A certificate for a common name.

        Args:
            name: common name.
            names: alternative names, as openssl writes them ("DNS:localhost").
            days: from now; 0: it has expired.
            file: stem of the files; default: the name.
        """
        stem = file or name
        pair = Pair(self._folder / f"{stem}.crt", self._folder / f"{stem}.key")
        request = self._folder / f"{stem}.csr"
        openssl(
            *("req", "-new", *CURVE, "-subj", f"/CN={name}"),
            *("-keyout", pair.key, "-out", request),
        )
        pair.key.chmod(0o600)
        extensions = self._folder / f"{stem}.ext"
        # What Python 3.13 requires where it checks by the letter of RFC 5280.
        text = "authorityKeyIdentifier=keyid\nsubjectKeyIdentifier=hash\n"
        extensions.write_text(text + (f"subjectAltName={names}\n" if names else ""))
        openssl(
            *("x509", "-req", "-in", request, "-out", pair.certificate),
            *("-CA", self.certificate, "-CAkey", self._key, "-CAcreateserial"),
            *(("-days", str(days)) if days else expired()),
            *("-extfile", extensions),
        )
        return pair
