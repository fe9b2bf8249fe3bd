"""Altered certificates are found: bytes anywhere, other signers, remade digests."""

import hashlib
import json
import random
import shutil
from pathlib import Path

import pytest
from lxml import etree

from tests.lab.certificates.made import Issued, issued
from traverse.lab.acceptance.certificate.values import digest_values
from traverse.lab.certificates.certificate import certify, checked_certificate
from traverse.lab.certificates.signature import (
    SIGNATURE,
    SigningKey,
    read_certificate,
    read_signing_key,
)
from traverse.lab.report.provenance import read_sums, sums_of, write_sums
from traverse.strict_toml.problems import FileError

N_MUTATIONS = 200


def problems(folder: Path, *trusted: Issued) -> list[str]:
    """What a check finds, however it says so."""
    try:
        signers = [signer.certificate for signer in trusted]
        return list(checked_certificate(folder, signers).problems)
    except FileError as error:
        return [str(error)]


def remake_sums(folder: Path) -> None:
    write_sums(folder, sums_of(folder, read_sums(folder)))


def mutated(content: bytes, chance: random.Random) -> bytes:
    """One byte altered, left out, added or a piece taken away."""
    at = chance.randrange(len(content))
    kind = chance.randrange(4)
    if kind == 0:
        other = (content[at] + chance.randrange(1, 256)) % 256
        return content[:at] + bytes([other]) + content[at + 1 :]
    if kind == 1:
        return content[:at] + content[at + 1 :]
    if kind == 2:
        return content[:at] + bytes([chance.randrange(256)]) + content[at:]
    return content[:at] + content[at + chance.randrange(1, 200) :]


def test_altered_bytes_anywhere_are_found(signed_verification, tmp_path):
    folder = shutil.copytree(signed_verification, tmp_path / "copy")
    chance = random.Random(7)
    names = [*read_sums(folder), "SHA256SUMS"]
    for name in names:
        path, original = folder / name, (folder / name).read_bytes()
        for _ in range(N_MUTATIONS // 20):
            changed = mutated(original, chance)
            path.write_bytes(changed)
            assert changed == original or problems(folder), (name, changed)
        path.write_bytes(original)
    assert problems(folder) == []


def test_altered_bytes_of_a_signed_certificate_with_remade_sums(
    signed_verification, tmp_path, signer
):
    """What passes says the same, signed by the same.

    A comma beside base 64, or a blank between elements of the signature, is neither
    signed nor read by anybody.
    """
    folder = shutil.copytree(signed_verification, tmp_path / "copy")
    chance, path = random.Random(8), folder / "dcc.xml"
    original = path.read_bytes()
    n_signed = original.index(b"<ds:Signature")
    n_found = 0
    for _ in range(N_MUTATIONS // 4):
        changed = mutated(original, chance)
        path.write_bytes(changed)
        remake_sums(folder)
        is_found = bool(problems(folder, signer))
        n_found += is_found
        assert is_found or changed[:n_signed] == original[:n_signed], changed
    assert n_found >= N_MUTATIONS // 4 - 1


@pytest.mark.parametrize(
    "name",
    ["certificate.html", "certificate.pdf", "data/limits.toml", "data/poses.csv"],
)
def test_a_file_altered_with_remade_sums(signed_verification, tmp_path, name):
    folder = shutil.copytree(signed_verification, tmp_path / "copy")
    path = folder / name
    path.write_bytes(path.read_bytes() + b"\n")
    remake_sums(folder)
    assert problems(folder)


def test_a_list_of_digests_with_a_line_less(signed_verification, tmp_path):
    folder = shutil.copytree(signed_verification, tmp_path / "copy")
    sums = folder / "SHA256SUMS"
    lines = sums.read_text().splitlines(keepends=True)
    for number, line in enumerate(lines):
        sums.write_text("".join([*lines[:number], *lines[number + 1 :]]))
        name = line.split()[-1]
        assert any(f"{name} is not in it" in problem for problem in problems(folder)), (
            name
        )


def test_sums_that_are_gone_or_point_elsewhere(signed_verification, tmp_path):
    folder = shutil.copytree(signed_verification, tmp_path / "copy")
    sums = folder / "SHA256SUMS"
    original = sums.read_text()
    sums.unlink()
    assert "SHA256SUMS is missing" in problems(folder)[0]
    outside = tmp_path / "secret"
    outside.write_text("x")
    digest = hashlib.sha256(b"x").hexdigest()
    sums.write_text(f"{digest}  ../secret\n" + original)
    assert any("lies elsewhere" in problem for problem in problems(folder))


def test_a_figure_remade_with_all_digests_does_not_follow(
    verified, laboratory, tmp_path, signer
):
    """Whoever has the laboratory's key and lies is found by the raw data."""
    folder = shutil.copytree(verified, tmp_path / "copy")
    certify(folder, laboratory, None)
    path = folder / "certificate.json"
    values = json.loads(path.read_text())
    files = values.pop("digest")["files"]
    expanded = values["figures"][0]["expanded_uncertainty_mm"]
    values["figures"][0]["expanded_uncertainty_mm"] = expanded / 10.0
    values["digest"] = digest_values(values, files)
    path.write_text(json.dumps(values, indent=1, ensure_ascii=False))
    remake_sums(folder)
    (problem,) = problems(folder)
    assert "dcc.xml was altered, or does not follow from the files" in problem
    with pytest.raises(FileError, match="expanded_uncertainty_mm: the data give"):
        certify(folder, laboratory, None)


def test_a_certificate_of_other_figures_signed_by_another(
    signed_verification, tmp_path, signer
):
    """A stranger's signature over altered figures is one of a stranger."""
    folder = shutil.copytree(signed_verification, tmp_path / "copy")
    stranger = issued("Laboratory 2026")
    certify(
        folder,
        folder / "data" / "laboratory.toml",
        SigningKey(stranger.key, stranger.certificate),
    )
    assert problems(folder) == []
    assert "who is not trusted" in problems(folder, signer)[0]
    assert problems(folder, stranger) == []
    assert problems(folder, signer, stranger) == []


@pytest.mark.parametrize("is_rsa", [False, True])
def test_an_authority_vouches_for_a_signer(verified, laboratory, tmp_path, is_rsa):
    folder = shutil.copytree(verified, tmp_path / "copy")
    authority = issued("Authority", is_authority=True, is_rsa=is_rsa)
    issued_key = issued("Laboratory", authority, is_rsa=is_rsa)
    certify(folder, laboratory, SigningKey(issued_key.key, issued_key.certificate))
    assert problems(folder, authority) == []
    # A colleague, no authority, who issued a certificate vouches for nobody.
    colleague = issued("Laboratory 1")
    issued_key = issued("Laboratory 2", colleague)
    certify(folder, laboratory, SigningKey(issued_key.key, issued_key.certificate))
    assert "not trusted" in problems(folder, colleague)[0]


def test_a_signature_moved_doubled_or_over_a_part(signed_verification, tmp_path):
    folder = shutil.copytree(signed_verification, tmp_path / "copy")
    path = folder / "dcc.xml"
    original = path.read_bytes()

    def changed(change) -> list[str]:
        root = etree.fromstring(original)
        (signature,) = root.findall(SIGNATURE)
        change(root, signature)
        declaration = b"<?xml version='1.0' encoding='UTF-8'?>\n"
        path.write_bytes(declaration + etree.tostring(root, encoding="UTF-8") + b"\n")
        remake_sums(folder)
        return problems(folder)

    def doubled(root, signature):
        root.append(etree.fromstring(etree.tostring(signature)))

    def inside(root, signature):
        root[1].append(signature)

    def of_a_part(root, signature):
        root[0].set("Id", "a")
        (reference,) = signature.iterfind(".//{*}Reference")
        reference.set("URI", "#a")

    def another_value(root, _signature):
        (value, *_) = root.iterfind(".//{*}uniqueIdentifier")
        value.text = "2026-0418"

    for change in (doubled, inside, of_a_part, another_value):
        assert changed(change), change
    assert changed(lambda *_: None) == []


def test_keys_that_cannot_sign(tmp_path):
    day = "2026-11-23"
    first, other = issued("A"), issued("B")
    late = issued("C", days=(1, 10))
    key, certificate = first.write(tmp_path, "own")
    _, another = other.write(tmp_path, "other")
    from datetime import date  # noqa: PLC0415

    issue = date.fromisoformat(day)
    assert read_signing_key(key, certificate, None, issue).certificate
    with pytest.raises(FileError, match="does not belong to the key"):
        read_signing_key(key, another, None, issue)
    with pytest.raises(FileError, match=f"valid from 2026-11-24 .*not on {day}"):
        read_signing_key(*late.write(tmp_path, "late"), None, issue)
    with pytest.raises(FileError, match="no private key in PEM form"):
        read_signing_key(certificate, certificate, None, issue)
    with pytest.raises(FileError, match=r"no X\.509 certificate"):
        read_certificate(key)
