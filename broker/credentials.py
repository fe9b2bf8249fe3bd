"""Credentials for a broker: password and certificates, and their files.

Files are read anew at every connection, so that they can be renewed. `credential:NAME`
is a credential of systemd (LoadCredential=). The password is stored in `Credentials`
alone, which does not show it.
"""

import hashlib
import os
import re
import ssl
import stat
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from traverse.broker.address import BrokerAddress
from traverse.broker.certificates import ends_of_pem
from traverse.plurals import counted
from traverse.strict_toml.files import bytes_of, open_regular
from traverse.strict_toml.ownership import reason_of_owner

CREDENTIAL = "credential:"
_NAME = re.compile(r"(?!\.)[A-Za-z0-9._-]{1,255}")
# A chain ends with its first certificate, a list of authorities with its last.
_CHAINS = ("certificate_file", min), ("ca_file", max)
MAX_FILE_BYTES = 1 << 20
MAX_PASSWORD_BYTES = 1024


class CredentialsError(Exception):
    """A file of a broker's address cannot be used.

    Attributes:
        key: of the table [broker], or attribute of the address, that names the file.
    """

    def __init__(self, key: str, text: str) -> None:
        super().__init__(f"{key}: {text}")
        self.key = key
        self.text = text


@dataclass(frozen=True, slots=True)
class Credentials:
    """Contents of the files at one moment.

    Attributes:
        tls: context of an encrypted connection, or None.
        digest: of all files, to detect changes.
        ends: of certificates, by key and path of their files.
    """

    password: str | None = field(repr=False)
    tls: ssl.SSLContext | None
    digest: bytes = field(repr=False)
    warnings: tuple[str, ...]
    ends: Mapping[str, datetime]


def credential_file(name: str, folder: Path = Path()) -> Path:
    """Return the file of a name: `credential:NAME`, or one in a folder.

    Raises:
        ValueError: it is no name of a credential, or systemd has passed none.
    """
    if not name.startswith(CREDENTIAL):
        return folder / name
    credential = name.removeprefix(CREDENTIAL)
    if not _NAME.fullmatch(credential):
        raise ValueError(
            f"{name!r} is no name of a credential; use letters, digits, '.', '_', '-'"
        )
    credentials = os.environ.get("CREDENTIALS_DIRECTORY")
    if credentials is None:
        raise ValueError(
            f"{name!r} is a credential of systemd, and $CREDENTIALS_DIRECTORY is not "
            f"set; start it by a unit with LoadCredential={credential}:FILE, or name a "
            "file"
        )
    return Path(credentials) / credential


def connection_options(
    address: BrokerAddress, credentials: Credentials | None = None
) -> dict[str, Any]:
    """Return arguments of `MqttClient`; files are read without credentials.

    Raises:
        CredentialsError: one of the files cannot be used.
    """
    credentials = credentials or read_credentials(address)
    return {
        "hostname": address.host,
        "port": address.tcp_port,
        "username": address.username,
        "password": credentials.password,
        "tls_context": credentials.tls,
        "file_ends": credentials.ends,
        "keep_alive_s": address.keepalive_s,
    }


def read_credentials(address: BrokerAddress) -> Credentials:
    """Read password and certificates.

    Raises:
        CredentialsError: one of them cannot be used.
    """
    files: dict[str, Path] = {}
    for key in ("password_file", "ca_file", "certificate_file", "key_file"):
        if (name := getattr(address, key)) is not None:
            try:
                files[key] = credential_file(str(name), address.folder)
            except ValueError as error:
                raise CredentialsError(key, str(error)) from error
    contents = {key: _content(key, path) for key, path in files.items()}
    digest = hashlib.sha256()
    for content in contents.values():
        digest.update(hashlib.sha256(content).digest())
    password = address.password
    if "password_file" in files:
        password = _password(files["password_file"], contents["password_file"])
    return Credentials(
        password,
        _context(files) if address.tls else None,
        digest.digest(),
        tuple(_warnings(address, files)),
        dict(_ends(files, contents)),
    )


def certificate_ends(address: BrokerAddress) -> Mapping[str, datetime]:
    """Return when certificates of its files end; systemd's are left out.

    Raises:
        CredentialsError: one of them cannot be read.
    """
    files: dict[str, Path] = {}
    for key, _ in _CHAINS:
        name = getattr(address, key)
        if name is not None and not str(name).startswith(CREDENTIAL):
            files[key] = address.folder / name
    return dict(_ends(files, {key: _content(key, path) for key, path in files.items()}))


def _content(key: str, path: Path) -> bytes:
    try:
        with open_regular(path) as file:
            content = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        why = reason_of_owner(error) or error.strerror or error
        raise CredentialsError(key, f"{path} cannot be read: {why}") from error
    if len(content) > MAX_FILE_BYTES:
        raise CredentialsError(key, f"{path} has more than {MAX_FILE_BYTES} bytes")
    return content


def _password(path: Path, content: bytes) -> str:
    key, content = "password_file", content.strip()
    try:
        password = content.decode("utf-8")
    except UnicodeDecodeError:
        # Not `from` it: a UnicodeDecodeError holds the password.
        raise CredentialsError(key, f"{path} is no text in UTF-8") from None
    if not 1 <= len(content) <= MAX_PASSWORD_BYTES:
        length = counted(len(content), "byte")
        text = f"holds {length}; a password has 1 to {MAX_PASSWORD_BYTES}"
        raise CredentialsError(key, f"{path} {text}")
    return password


def _context(files: Mapping[str, Path]) -> ssl.SSLContext:
    authorities = files.get("ca_file")
    try:
        context = tls_context(authorities)
    except OSError as error:
        text = f"{authorities} holds no certificate in PEM ({_why(error)})"
        raise CredentialsError("ca_file", text) from error
    certificate = files.get("certificate_file")
    if certificate is None:
        return context
    key_file = files.get("key_file", certificate)

    def refuse() -> str:
        raise CredentialsError(
            "key_file",
            f"{key_file} is encrypted, and nobody is prompted for its passphrase. Take "
            "it off (openssl pkey) and let only the user of this program read it",
        )

    try:
        load_pair(context, certificate, key_file, refuse)
    except OSError as error:
        why = _why(error)
        if "KEY_VALUES_MISMATCH" in why:
            text = f"{key_file} is not the key of {certificate}"
            raise CredentialsError("key_file", text) from error
        raise CredentialsError(
            "certificate_file",
            f"{certificate} and {key_file} are no certificate and key in PEM ({why})",
        ) from error
    return context


def _why(error: OSError) -> str:
    return getattr(error, "reason", None) or error.strerror or type(error).__name__


def _ends(
    files: Mapping[str, Path], contents: Mapping[str, bytes]
) -> Iterator[tuple[str, datetime]]:
    for key, end_of in _CHAINS:
        if ends := ends_of_pem(contents.get(key, b"")):
            yield f"{key} {files[key]}", end_of(ends)


def _warnings(address: BrokerAddress, files: Mapping[str, Path]) -> Iterator[str]:
    for key, path in files.items():
        name = str(getattr(address, key))
        if key not in ("password_file", "key_file") or name.startswith(CREDENTIAL):
            continue  # systemd sees to its own
        mode = stat.S_IMODE(path.stat().st_mode)
        if mode & 0o077:
            yield (
                f"{path} ({key} of [broker]) can be read by others than its owner "
                f"(mode {mode:04o}); chmod 600 it"
            )
    is_far = address.host not in ("localhost", "127.0.0.1", "::1")
    if address.password_file is not None and not address.tls and is_far:
        yield (
            f"the password for broker {address} crosses the network in plain text; "
            "set tls = true in [broker]"
        )


def tls_context(ca_file: Path | None) -> ssl.SSLContext:
    """Return the TLS context for a broker, without a client certificate.

    The broker's certificate is signed by one of ``ca_file``, or by the system's.

    Raises:
        OSError: the file cannot be read, or holds no certificate.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    if ca_file is None:
        context.load_default_certs(ssl.Purpose.SERVER_AUTH)
    else:
        bytes_of(ca_file)  # OpenSSL would wait for a pipe
        context.load_verify_locations(ca_file)
    return context


def load_pair(
    context: ssl.SSLContext,
    certificate: Path,
    key: Path | None,
    passphrase: Callable[[], str] = str,
) -> None:
    """Use a certificate and its key, PEM, which may be in the same file.

    The passphrase is asked for an encrypted key; OpenSSL would prompt at the terminal.

    Raises:
        OSError: a file cannot be read, or they are no pair.
    """
    for file in (certificate, key or certificate):
        bytes_of(file)
    context.load_cert_chain(certificate, key, passphrase)
