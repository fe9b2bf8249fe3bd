CREATE TABLE checks (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    time_utc TEXT NOT NULL,
    arm TEXT NOT NULL,
    arm_digest TEXT NOT NULL,
    data_digest TEXT NOT NULL,
    begins TEXT NOT NULL,
    spat_2s_mm REAL NOT NULL,
    spat_max_mm REAL NOT NULL,
    sphere_form_mm REAL NOT NULL,
    sphere_diameter_mm REAL NOT NULL,
    n_cone INTEGER NOT NULL,
    n_sphere INTEGER NOT NULL,
    sphere_radius_mm REAL NOT NULL,
    temperature_c REAL,
    stated_mm REAL,
    UNIQUE (arm, data_digest)
)
