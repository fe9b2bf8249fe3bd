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
