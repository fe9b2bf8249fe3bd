"""Results to certify: a verification and an identification, made once."""

import shutil
from pathlib import Path

import pytest

from tests import results
from tests.lab.certificates.made import LABORATORY, Issued, issued
from tests.results import ARM
from tests.shared import new_folder, shared
from traverse.lab.certificates.certificate import certify
from traverse.lab.certificates.evidence import add_data
from traverse.lab.certificates.signature import SigningKey


@pytest.fixture(scope="session")
def laboratory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("laboratory") / "laboratory.toml"
    path.write_text(LABORATORY, "utf-8")
    return path


@pytest.fixture(scope="session")
def signer() -> Issued:
    return issued("Laboratory 2026")


@pytest.fixture(scope="session")
def verified() -> Path:
    """A folder as `traverse verify` leaves it."""
    return results.verified() / "out"


@shared
def _identified() -> Path:
    folder = shutil.copytree(results.identified(), new_folder(), dirs_exist_ok=True)
    add_data(folder / "out", folder / "campaign", ARM)
    return folder / "out"


@pytest.fixture(scope="session")
def identified() -> Path:
    """A folder as `traverse identify` leaves it, with its raw data."""
    return _identified()


def _signed(source: Path, folder: Path, laboratory: Path, signer: Issued) -> Path:
    copy = shutil.copytree(source, folder / "results")
    certify(copy, laboratory, SigningKey(signer.key, signer.certificate))
    return copy


@pytest.fixture(scope="session")
def signed_verification(
    verified: Path,
    laboratory: Path,
    signer: Issued,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    return _signed(verified, tmp_path_factory.mktemp("signed"), laboratory, signer)


@pytest.fixture(scope="session")
def signed_identification(
    identified: Path,
    laboratory: Path,
    signer: Issued,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    return _signed(identified, tmp_path_factory.mktemp("signed"), laboratory, signer)
