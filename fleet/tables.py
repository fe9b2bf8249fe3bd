"""The tables of a store, as steps from each version to the next.

The same statements make them in PostgreSQL and in SQLite. A step is never changed once
it was published: a change is another step.
"""

from pathlib import Path

from traverse.fleet.database import Database, StoreRefusedError
from traverse.strict_toml.files import text_of

# 1: what arms publish; 2: what is brought in as files.
STEPS = tuple(text_of(Path(__file__).with_name(f"tables_{n}.sql")) for n in (1, 2))


def migrate(database: Database) -> int:
    """Bring the tables to this version, one step a transaction; return how many.

    Members that begin at once wait for one another.

    Raises:
        StoreRefusedError: the tables are of a later version.
    """
    with database.transaction() as run:
        database.lock_tables(run)
        run("CREATE TABLE IF NOT EXISTS store_version (version BIGINT PRIMARY KEY)")
    done = 0
    while True:
        with database.transaction() as run:
            database.lock_tables(run)
            ((version,),) = run("SELECT coalesce(max(version), 0) FROM store_version")
            if version > len(STEPS):
                raise StoreRefusedError(
                    f"{database.name}: its tables are of version {version}; this "
                    f"Traverse knows those up to {len(STEPS)}: use a later one"
                )
            if version == len(STEPS):
                return done
            for statement in STEPS[version].split(";"):
                if statement.strip():
                    run(statement)
            run("INSERT INTO store_version VALUES (%s)", (version + 1,))
            done += 1
