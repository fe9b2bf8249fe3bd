import uuid
from collections.abc import Iterator

import pytest

from tests.postgres import Postgres
from traverse.fleet.opening import open_database
from traverse.fleet.tables import migrate


@pytest.fixture(scope="session")
def server() -> Iterator[Postgres]:
    """For tests that do not disturb it; mark them `needs("postgresql")`."""
    postgres_server = Postgres()
    yield postgres_server
    postgres_server.close()


@pytest.fixture
def postgres_url(server: Postgres) -> str:
    return server.new_database(f"t{uuid.uuid4().hex[:12]}")


@pytest.fixture(params=["sqlite", "postgresql"])
def database(request, tmp_path, postgres_url):
    is_file = request.param == "sqlite"
    opened = open_database(str(tmp_path / "store.db") if is_file else postgres_url)
    migrate(opened)
    yield opened
    opened.close()


@pytest.fixture
def postgres() -> Iterator[Postgres]:
    """A server with an empty database `fleet`, to be stopped and killed."""
    postgres_server = Postgres()
    postgres_server.new_database("fleet")
    yield postgres_server
    postgres_server.close()
