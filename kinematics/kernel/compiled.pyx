# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True
"""The kernel in C as seen from Python: one arm, ready for computing.

`variant.inc` has the mathematics. Arrays of any strides are read; the GIL is released
while a long block is computed; nothing is allocated where the results have a place to go.
"""

from cpython.buffer cimport (
    PyBUF_C_CONTIGUOUS,
    PyBUF_FORMAT,
    PyBUF_STRIDES,
    PyBUF_WRITABLE,
    PyBuffer_Release,
    PyObject_GetBuffer,
)
from cpython.list cimport PyList_CheckExact, PyList_GetItem, PyList_Size
from cpython.pystate cimport PyThreadState
from cpython.tuple cimport PyTuple_CheckExact, PyTuple_GetItem, PyTuple_Size
from libc.string cimport memcpy

import numpy as np

from traverse.kinematics.kernel.arm cimport (
    MOST_JOINTS,
    N_VARIANTS,
    arm_t,
    derivatives_t,
    table_t,
    variant_at,
    variant_runs,
    variant_t,
)

cdef extern from "Python.h":
    PyThreadState *PyEval_SaveThread()
    void PyEval_RestoreThread(PyThreadState *state)

LARGEST_N_JOINTS = MOST_JOINTS
cdef Py_ssize_t RELEASED_FROM = 256


cdef PyThreadState *release_gil(Py_ssize_t n_samples):
    """Release it for a long block; to get it back takes longer than a short one."""
    return PyEval_SaveThread() if n_samples >= RELEASED_FROM else NULL


cdef void take_gil(PyThreadState *released):
    if released != NULL:
        PyEval_RestoreThread(released)


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


include "floats.pxi"


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
        released = release_gil(n_samples)
        self.code.poses(&self.arm, source, n_samples, to_centres, to_directions)
        take_gil(released)
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
        released = release_gil(n_samples)
        self.code.poses(&self.arm, source, n_samples, to_centres, nowhere)
        take_gil(released)
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
        released = release_gil(n_samples)
        self.code.skeletons(&self.arm, source, n_samples, to_positions, NULL)
        take_gil(released)
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
        released = release_gil(n_samples)
        self.code.skeletons(
            &self.arm, source, n_samples, to_positions, to_rotations
        )
        take_gil(released)
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
        released = release_gil(n_samples)
        self.code.derivatives(&self.arm, source, n_samples, to)
        take_gil(released)
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
        take(angles_rad, self.arm.n_joints, readings)
        self.code.pose(&self.arm, readings, x, d)
        return (x[0], x[1], x[2]), (d[0], d[1], d[2])

    def centre(self, angles_rad):
        """Compute one sample's centre, three floats, of what `pose` takes."""
        cdef double readings[32]
        cdef double x[3]
        take(angles_rad, self.arm.n_joints, readings)
        self.code.pose(&self.arm, readings, x, NULL)
        return x[0], x[1], x[2]

    cdef Floats _readings(self, angles_rad, Py_ssize_t n_samples):
        return held("angles_rad", angles_rad, (n_samples, self.arm.n_joints), 0)


include "effects.pxi"
