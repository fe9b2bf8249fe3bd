"""What `arm.h` declares."""


cdef extern from "arm.h" nogil:
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
    const variant_t *variant_at(int which)
    int variant_runs(int which)
