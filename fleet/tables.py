"""The tables of a store, as steps from each version to the next.

The same statements make them in PostgreSQL and in SQLite. A step is never changed once
it was published: what is new is another step.
"""

from traverse.fleet.database import Database, StoreRefusedError

STEPS = (
    # 1: what arms publish.
    """
    CREATE TABLE point (
        id TEXT NOT NULL, arm TEXT NOT NULL, session TEXT NOT NULL, seq BIGINT NOT NULL,
        time_ns BIGINT NOT NULL, retracts TEXT,
        x_mm DOUBLE PRECISION NOT NULL, y_mm DOUBLE PRECISION NOT NULL,
        z_mm DOUBLE PRECISION NOT NULL,
        part_x_mm DOUBLE PRECISION, part_y_mm DOUBLE PRECISION,
        part_z_mm DOUBLE PRECISION,
        std_mm DOUBLE PRECISION, temperature_c DOUBLE PRECISION,
        artefact TEXT, feature TEXT, ok BOOLEAN NOT NULL, flags TEXT NOT NULL,
        model TEXT NOT NULL, message BYTEA NOT NULL,
        PRIMARY KEY (id, time_ns)
    );
    CREATE INDEX point_of_session ON point (arm, session, seq);
    CREATE INDEX point_of_time ON point (arm, time_ns);
    CREATE INDEX point_retracts ON point (retracts) WHERE retracts IS NOT NULL;
    CREATE VIEW standing_point AS SELECT * FROM point
        WHERE retracts IS NULL AND NOT EXISTS (
            SELECT 1 FROM point AS undo WHERE undo.retracts = point.id);
    CREATE TABLE event (
        arm TEXT NOT NULL, session TEXT, severity TEXT NOT NULL, code TEXT NOT NULL,
        source TEXT NOT NULL, active BOOLEAN, first_ns BIGINT NOT NULL,
        last_ns BIGINT NOT NULL, count BIGINT NOT NULL, text TEXT NOT NULL,
        remedy TEXT NOT NULL, data TEXT NOT NULL,
        PRIMARY KEY (arm, first_ns, code, source, last_ns)
    );
    CREATE TABLE arm (
        arm TEXT PRIMARY KEY, time_ns BIGINT NOT NULL, online BOOLEAN NOT NULL,
        state TEXT NOT NULL, session TEXT, model TEXT, version TEXT NOT NULL,
        alarms BIGINT, status BYTEA NOT NULL
    );
    CREATE TABLE health (
        arm TEXT PRIMARY KEY, time_ns BIGINT NOT NULL, temperature_c DOUBLE PRECISION,
        points_unsent BIGINT NOT NULL, health BYTEA NOT NULL
    );
    CREATE TABLE scan_block (
        arm TEXT NOT NULL, session TEXT NOT NULL, scan TEXT NOT NULL,
        seq BIGINT NOT NULL, points BIGINT NOT NULL, time_ns BIGINT NOT NULL,
        last BOOLEAN NOT NULL, total BIGINT, file TEXT NOT NULL,
        PRIMARY KEY (arm, session, scan, seq)
    );
    CREATE TABLE series (
        arm TEXT NOT NULL, session TEXT NOT NULL, scan TEXT NOT NULL,
        first_ns BIGINT NOT NULL, last_seq BIGINT NOT NULL,
        complete_to BIGINT NOT NULL, gap_since_ns BIGINT,
        PRIMARY KEY (arm, session, scan)
    );
    CREATE INDEX series_open ON series (arm) WHERE complete_to < last_seq;
    CREATE TABLE lost (
        arm TEXT NOT NULL, session TEXT NOT NULL, scan TEXT NOT NULL,
        from_seq BIGINT NOT NULL, to_seq BIGINT NOT NULL, time_ns BIGINT NOT NULL,
        reason TEXT NOT NULL,
        PRIMARY KEY (arm, session, scan, from_seq)
    );
    CREATE TABLE refused (
        time_ns BIGINT NOT NULL, topic TEXT NOT NULL, reason TEXT NOT NULL,
        payload BYTEA NOT NULL
    );
    CREATE INDEX refused_of_time ON refused (time_ns);
    CREATE TABLE lease (
        name TEXT PRIMARY KEY, member TEXT NOT NULL, until_ns BIGINT NOT NULL
    );
    """,
    # 2: what is brought in as files.
    """
    CREATE TABLE certificate (
        digest TEXT PRIMARY KEY, arm TEXT NOT NULL, kind TEXT NOT NULL,
        time_ns BIGINT NOT NULL, verdict TEXT, file TEXT NOT NULL,
        content BYTEA NOT NULL
    );
    CREATE INDEX certificate_of_arm ON certificate (arm, time_ns);
    CREATE TABLE daily_check (
        arm TEXT NOT NULL, data_digest TEXT NOT NULL, time_utc TEXT NOT NULL,
        arm_digest TEXT NOT NULL, begins TEXT NOT NULL, figures TEXT NOT NULL,
        PRIMARY KEY (arm, data_digest)
    );
    """,
)


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
