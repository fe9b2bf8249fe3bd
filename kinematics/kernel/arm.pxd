"""What `arm.h` and `effects.h` declare."""


from libc.stdint cimport int64_t


cdef extern from "effects.h" nogil:
    const int MOST_JOINTS
    const int N_VARIANTS
    ctypedef struct arm_t:
        int n_joints
        double origin_mm[3]
        double direction[3]
        double zeros_rad[32]
        double axes[32][3]
        double links_mm[32][3]
    ctypedef struct table_t:
        char *data
        Py_ssize_t row
        Py_ssize_t column
    ctypedef struct derivatives_t:
        double *centres_mm
        double *by_angles
        double *by_axes
        double *by_links
    ctypedef struct term_t:
        int form
        int source
        int joint
        int source_joint
        double order
        double reference
        int64_t epoch_ns
        int64_t start_ns
        int64_t end_ns
        double values[6]
        int n_knots
        const double *knots
    ctypedef struct effects_t:
        int n_terms
        const term_t *terms
        int moves[32]
        int moves_mount
        int moves_base
        int weighs
        double levers_kg_m[32][3]
        double element_mm[32][3]
        double probe_mm[3]
    ctypedef struct samples_t:
        table_t angles_rad
        table_t speeds_rad_s
        table_t approaches
        table_t joint_temperatures_c
        table_t temperature_c
        table_t utc_ns
        table_t campaign_s
        table_t force_n
        double gravity_m_s2[3]
    ctypedef struct variant_t:
        const char *name
        void (*poses)(
            const arm_t *, table_t, Py_ssize_t, table_t, table_t
        ) noexcept nogil
        void (*skeletons)(
            const arm_t *, table_t, Py_ssize_t, double *, double *
        ) noexcept nogil
        void (*derivatives)(
            const arm_t *, table_t, Py_ssize_t, derivatives_t
        ) noexcept nogil
        void (*pose)(
            const arm_t *, const double *, double *, double *
        ) noexcept nogil
        void (*deflected)(
            const arm_t *, const effects_t *, const samples_t *, Py_ssize_t, table_t,
            table_t
        ) noexcept nogil
    const variant_t *variant_at(int which)
    int variant_runs(int which)
