"""A database of an outbox, and an outbox on the loop."""

import pytest

from tests.daemon.store.outbox_harness import OutboxOnLoop
from traverse.daemon.store.database import MessageDatabase


@pytest.fixture
def path(tmp_path):
    return tmp_path / "outbox.db"


@pytest.fixture
def store(path):
    opened = MessageDatabase(path)
    yield opened
    opened.close()


@pytest.fixture
async def bench(tmp_path):
    bench = OutboxOnLoop(tmp_path)
    async with bench.outbox.running():
        yield bench
