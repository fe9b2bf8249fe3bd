"""A database of an outbox, as several files of tests want it."""

import pytest

from traverse.daemon.store.database import MessageDatabase


@pytest.fixture
def path(tmp_path):
    return tmp_path / "outbox.db"


@pytest.fixture
def store(path):
    opened = MessageDatabase(path)
    yield opened
    opened.close()
