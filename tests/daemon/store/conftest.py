"""A database of an outbox, as several files of tests want it."""

import pytest

from traverse.daemon.store.database import OutboxStore


@pytest.fixture
def path(tmp_path):
    return tmp_path / "outbox.db"


@pytest.fixture
def store(path):
    opened = OutboxStore(path)
    yield opened
    opened.close()
