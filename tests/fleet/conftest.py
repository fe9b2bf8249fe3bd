"""A PostgreSQL for a test."""

from collections.abc import Iterator

import pytest

from tests.postgres import Postgres


@pytest.fixture
def postgres() -> Iterator[Postgres]:
    server = Postgres()
    yield server
    server.close()
