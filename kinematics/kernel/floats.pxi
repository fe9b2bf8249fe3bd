"""Arrays whose memory the kernel works on; part of `compiled.pyx`."""

cdef class Floats:
    """An array of 64 bits an item while the kernel has hold of its memory."""

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
        found.column = self.buffer.strides[1] if self.buffer.ndim > 1 else 0
        return found


cdef Floats held(
    str name, object array, tuple shape, int flags, bytes letter=b"d"
):
    """Take hold of an array, checked: everything behind this trusts its shape.

    `letter` is what its items are: float64, or for b"l" int64.
    """
    cdef Floats floats = Floats()
    cdef Py_buffer *buffer = &floats.buffer
    cdef int axis
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}, expected {shape}")
    PyObject_GetBuffer(array, buffer, PyBUF_FORMAT | PyBUF_STRIDES | flags)
    floats.held = True
    if buffer.ndim != len(shape):
        raise ValueError(f"{name} has {buffer.ndim} dimensions, expected {len(shape)}")
    cdef bint aligned = <size_t>buffer.buf % sizeof(double) == 0
    for axis in range(buffer.ndim):
        # What an object says of itself need not be what its memory is.
        if buffer.shape[axis] != <Py_ssize_t>shape[axis]:
            raise ValueError(f"{name} has memory of another shape, expected {shape}")
        # Nothing is that far apart where there is only one.
        if buffer.shape[axis] > 1 and buffer.strides[axis] % sizeof(double) != 0:
            aligned = False
    if buffer.itemsize != 8 or bytes(buffer.format) != letter or not aligned:
        raise ValueError(
            f"{name} has dtype {array.dtype}, expected aligned "
            f"{'float64' if letter == b'd' else 'int64'} in the byte order of this "
            "machine"
        )
    return floats


cdef int take(object angles_rad, Py_ssize_t n_joints, double *readings) except -1:
    """Read one sample out of a tuple, a list or an array."""
    cdef Py_ssize_t k
    cdef Py_buffer buffer
    if PyTuple_CheckExact(angles_rad):
        if PyTuple_Size(angles_rad) != n_joints:
            raise wrong_sample(angles_rad, n_joints)
        for k in range(n_joints):
            readings[k] = <object>PyTuple_GetItem(angles_rad, k)
        return 0
    if PyList_CheckExact(angles_rad):
        if PyList_Size(angles_rad) != n_joints:
            raise wrong_sample(angles_rad, n_joints)
        for k in range(n_joints):
            # An odd float could change the list while it is read.
            if k >= PyList_Size(angles_rad):
                raise wrong_sample(angles_rad, n_joints)
            readings[k] = <object>PyList_GetItem(angles_rad, k)
        return 0
    PyObject_GetBuffer(angles_rad, &buffer, PyBUF_FORMAT | PyBUF_STRIDES)
    try:
        if (
            buffer.ndim != 1
            or buffer.shape[0] != n_joints
            or buffer.format[0] != b"d"
            or buffer.format[1] != 0
        ):
            raise wrong_sample(angles_rad, n_joints)
        for k in range(n_joints):
            memcpy(&readings[k], <char *>buffer.buf + k * buffer.strides[0], 8)
    finally:
        PyBuffer_Release(&buffer)
    return 0


cdef wrong_sample(angles_rad, n_joints):
    return ValueError(
        f"angles_rad is {angles_rad!r}, expected {n_joints} floats: one for each joint "
        "of the arm"
    )
