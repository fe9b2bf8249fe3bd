# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True
"""The kernel in C as seen from Python: one arm, ready for computing.

`variant.inc` has the mathematics. Arrays of any strides are read; the GIL is released
while a block is computed; nothing is allocated where the results have a place to go.
"""

from cpython.buffer cimport (
    PyBUF_C_CONTIGUOUS,
    PyBUF_FORMAT,
    PyBUF_STRIDES,
    PyBUF_WRITABLE,
    PyBuffer_Release,
    PyObject_GetBuffer,
)
from cpython.list cimport PyList_CheckExact, PyList_GET_ITEM, PyList_GET_SIZE
from cpython.tuple cimport PyTuple_CheckExact, PyTuple_GET_ITEM, PyTuple_GET_SIZE

import numpy as np


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


LARGEST_N_JOINTS = MOST_JOINTS


def runnable_variants():
    """Name the variants that this processor runs, the fastest last."""
    return tuple(
        variant_at(which).name.decode()
        for which in range(N_VARIANTS)
        if variant_at(which) != NULL and variant_runs(which)
    )


cdef const variant_t *variant_named(str name) except NULL:
    for which in range(N_VARIANTS):
        if variant_at(which) != NULL and variant_at(which).name.decode() == name:
            if variant_runs(which):
                return variant_at(which)
    raise ValueError(
        f"kernel: variant {name!r} does not run on this processor, expected one of "
        f"{', '.join(runnable_variants())}"
    )


cdef class Floats:
    """An array of float64 while the kernel has hold of its memory."""

    cdef Py_buffer buffer
    cdef bint held

    def __cinit__(self):
        self.held = False

    def __dealloc__(self):
        if self.held:
            PyBuffer_Release(&self.buffer)

    cdef double *data(self) noexcept:
        return <double *>self.buffer.buf

    cdef table_t table(self) noexcept:
        cdef table_t found
        found.data = <char *>self.buffer.buf
        found.row = self.buffer.strides[0]
        found.column = self.buffer.strides[1]
        return found


cdef Floats held(str name, object array, tuple shape, int flags):
    """Take hold of an array, checked: everything behind this trusts its shape."""
    cdef Floats floats = Floats()
    cdef Py_buffer *buffer = &floats.buffer
    cdef int axis
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
    PyObject_GetBuffer(array, buffer, PyBUF_FORMAT | PyBUF_STRIDES | flags)
    floats.held = True
    cdef bint aligned = <size_t>buffer.buf % sizeof(double) == 0
    for axis in range(buffer.ndim):
        aligned = aligned and buffer.strides[axis] % <Py_ssize_t>sizeof(double) == 0
    if buffer.format[0] != b"d" or buffer.format[1] != 0 or not aligned:
        raise ValueError(
            f"{name} has dtype {array.dtype}, expected aligned float64 in the byte "
            "order of this machine"
        )
    return floats


cdef class Chain:
    """One arm for one variant of the kernel.

    Args:
        geometry: The arm, of at most LARGEST_N_JOINTS joints.
        variant: One of `runnable_variants()`.
    """

    cdef arm_t arm
    cdef const variant_t *code

    def __init__(self, geometry, str variant):
        cdef int n_joints = len(geometry.axes)
        cdef int k, c
        if n_joints > MOST_JOINTS:
            raise ValueError(
                f"kernel: the arm has {n_joints} joints, expected at most {MOST_JOINTS}"
            )
        self.code = variant_named(variant)
        self.arm.n_joints = n_joints
        zeros_rad = geometry.zeros_rad.tolist()
        axes = geometry.axes.tolist()
        links_mm = geometry.links_mm.tolist()
        probe_mm = geometry.probe_vector_mm.tolist()
        for k in range(MOST_JOINTS):
            self.arm.zeros_rad[k] = zeros_rad[k] if k < n_joints else 0.0
        for c in range(3):
            self.arm.origin_mm[c] = geometry.origin_mm[c]
            self.arm.direction[c] = geometry.probe_direction[c]
            for k in range(n_joints):
                self.arm.axes[k][c] = axes[k][c]
                self.arm.links_mm[k][c] = links_mm[k][c]
            self.arm.links_mm[n_joints - 1][c] += <double>probe_mm[c]

    @property
    def variant(self):
        """Which variant computes."""
        return self.code.name.decode()

    def poses(self, angles_rad, centres_mm=None, directions=None):
        """Compute centres and directions.

        Args:
            angles_rad: Readings, (n_samples, n_joints).
            centres_mm: Where the centres go, (n_samples, 3); new where absent.
            directions: Where the directions go, likewise.

        Returns:
            The centres and the directions.
        """
        cdef Py_ssize_t n_samples = len(angles_rad)
        cdef Floats readings = self._readings(angles_rad, n_samples)
        if centres_mm is None:
            centres_mm = np.empty((n_samples, 3))
        if directions is None:
            directions = np.empty((n_samples, 3))
        cdef Floats x = held("centres_mm", centres_mm, (n_samples, 3), PyBUF_WRITABLE)
        cdef Floats d = held("directions", directions, (n_samples, 3), PyBUF_WRITABLE)
        cdef table_t to_centres = x.table()
        cdef table_t to_directions = d.table()
        cdef table_t source = readings.table()
        with nogil:
            self.code.poses(&self.arm, source, n_samples, to_centres, to_directions)
        return centres_mm, directions

    def centres(self, angles_rad, out=None):
        """Compute centres alone: (n_samples, n_joints) -> (n_samples, 3)."""
        cdef Py_ssize_t n_samples = len(angles_rad)
        cdef Floats readings = self._readings(angles_rad, n_samples)
        if out is None:
            out = np.empty((n_samples, 3))
        cdef Floats x = held("out", out, (n_samples, 3), PyBUF_WRITABLE)
        cdef table_t to_centres = x.table()
        cdef table_t nowhere = table_t(data=NULL, row=0, column=0)
        cdef table_t source = readings.table()
        with nogil:
            self.code.poses(&self.arm, source, n_samples, to_centres, nowhere)
        return out

    def positions(self, angles_rad, out=None):
        """Compute the joints' origins and the centre, (n_samples, n_joints + 1, 3).

        Where `out` is given it must be C-contiguous.
        """
        cdef Py_ssize_t n_samples = len(angles_rad)
        cdef Floats readings = self._readings(angles_rad, n_samples)
        shape = (n_samples, self.arm.n_joints + 1, 3)
        if out is None:
            out = np.empty(shape)
        cdef Floats o = held("out", out, shape, PyBUF_WRITABLE | PyBUF_C_CONTIGUOUS)
        cdef table_t source = readings.table()
        cdef double *to_positions = o.data()
        with nogil:
            self.code.skeletons(&self.arm, source, n_samples, to_positions, NULL)
        return out

    def joint_poses(self, angles_rad, positions_mm=None, rotations=None):
        """Compute where every joint is and how what it carries is turned.

        Args:
            angles_rad: Readings, (n_samples, n_joints).
            positions_mm: Where the joints' origins and the centre go, C-contiguous
                (n_samples, n_joints + 1, 3); new where absent.
            rotations: Where P_k goes, C-contiguous (n_samples, n_joints, 3, 3).

        Returns:
            The positions and the rotations.
        """
        cdef Py_ssize_t n_samples = len(angles_rad)
        cdef Floats readings = self._readings(angles_rad, n_samples)
        cdef int flags = PyBUF_WRITABLE | PyBUF_C_CONTIGUOUS
        places = (n_samples, self.arm.n_joints + 1, 3)
        turns = (n_samples, self.arm.n_joints, 3, 3)
        if positions_mm is None:
            positions_mm = np.empty(places)
        if rotations is None:
            rotations = np.empty(turns)
        cdef Floats o = held("positions_mm", positions_mm, places, flags)
        cdef Floats p = held("rotations", rotations, turns, flags)
        cdef table_t source = readings.table()
        cdef double *to_positions = o.data()
        cdef double *to_rotations = p.data()
        with nogil:
            self.code.skeletons(
                &self.arm, source, n_samples, to_positions, to_rotations
            )
        return positions_mm, rotations

    def derivatives(self, angles_rad, out=None):
        """Compute centres and derivatives as `ProbeDerivatives` has them.

        Args:
            angles_rad: Readings, (n_samples, n_joints).
            out: Four C-contiguous arrays of the shapes of its attributes.

        Returns:
            The four arrays.
        """
        cdef Py_ssize_t n_samples = len(angles_rad)
        cdef Floats readings = self._readings(angles_rad, n_samples)
        cdef int flags = PyBUF_WRITABLE | PyBUF_C_CONTIGUOUS
        angles = (n_samples, 3, self.arm.n_joints)
        vectors = (*angles, 3)
        if out is None:
            out = (
                np.empty((n_samples, 3)),
                np.empty(angles),
                np.empty(vectors),
                np.empty(vectors),
            )
        centres_mm, by_angles, by_axes, by_links = out
        cdef Floats x = held("centres_mm", centres_mm, (n_samples, 3), flags)
        cdef Floats a = held("by_angles", by_angles, angles, flags)
        cdef Floats u = held("by_axes", by_axes, vectors, flags)
        cdef Floats r = held("by_links", by_links, vectors, flags)
        cdef derivatives_t to
        to.centres_mm = x.data()
        to.by_angles = a.data()
        to.by_axes = u.data()
        to.by_links = r.data()
        cdef table_t source = readings.table()
        with nogil:
            self.code.derivatives(&self.arm, source, n_samples, to)
        return out

    def pose(self, angles_rad):
        """Compute one sample with as little around it as possible.

        Args:
            angles_rad: n_joints readings: a list or tuple of floats, or an array.

        Returns:
            The centre and the direction, three floats each.
        """
        cdef double readings[32]
        cdef double x[3]
        cdef double d[3]
        self._take(angles_rad, readings)
        self.code.pose(&self.arm, readings, x, d)
        return (x[0], x[1], x[2]), (d[0], d[1], d[2])

    def centre(self, angles_rad):
        """Compute one sample's centre, three floats, of what `pose` takes."""
        cdef double readings[32]
        cdef double x[3]
        self._take(angles_rad, readings)
        self.code.pose(&self.arm, readings, x, NULL)
        return x[0], x[1], x[2]

    cdef Floats _readings(self, angles_rad, Py_ssize_t n_samples):
        return held("angles_rad", angles_rad, (n_samples, self.arm.n_joints), 0)

    cdef int _take(self, angles_rad, double *readings) except -1:
        cdef Py_ssize_t n_joints = self.arm.n_joints
        cdef Py_ssize_t k
        cdef Py_buffer buffer
        if PyTuple_CheckExact(angles_rad):
            if PyTuple_GET_SIZE(angles_rad) != n_joints:
                raise self._wrong(angles_rad)
            for k in range(n_joints):
                readings[k] = <object>PyTuple_GET_ITEM(angles_rad, k)
            return 0
        if PyList_CheckExact(angles_rad):
            if PyList_GET_SIZE(angles_rad) != n_joints:
                raise self._wrong(angles_rad)
            for k in range(n_joints):
                # An odd float could change the list while it is read.
                if k >= PyList_GET_SIZE(angles_rad):
                    raise self._wrong(angles_rad)
                readings[k] = <object>PyList_GET_ITEM(angles_rad, k)
            return 0
        PyObject_GetBuffer(angles_rad, &buffer, PyBUF_FORMAT | PyBUF_STRIDES)
        try:
            if (
                buffer.ndim != 1
                or buffer.shape[0] != n_joints
                or buffer.format[0] != b"d"
                or buffer.format[1] != 0
            ):
                raise self._wrong(angles_rad)
            for k in range(n_joints):
                readings[k] = (<double *>(<char *>buffer.buf + k * buffer.strides[0]))[0]
        finally:
            PyBuffer_Release(&buffer)
        return 0

    cdef _wrong(self, angles_rad):
        return ValueError(
            f"angles_rad is {angles_rad!r}, expected {self.arm.n_joints} floats: one "
            "for each joint of the arm"
        )
