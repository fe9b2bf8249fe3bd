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
