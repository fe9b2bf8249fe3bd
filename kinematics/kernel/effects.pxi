"""An arm with effects, ready for computing; part of `compiled.pyx`."""

from libc.stdint cimport int64_t
from libc.stdlib cimport calloc, free

from traverse.kinematics.kernel.arm cimport effects_t, samples_t, term_t

# What a form moves at its joint, as in effects.h; the mount and the base by their own.
cdef int MOVES[10]
MOVES[:] = [1, 1, 1, 2, 4, 0, 4, 8, 16, 0]
cdef enum:
    SPLINE = 2
    MOUNT = 5
    BASE = 9
    # The sources that are columns of joints; the last one may be of the arm.
    LAST_OF_JOINT = 4
    TEMPERATURE = 5
    DRIFT = 6
    STEP = 7
    CAMPAIGN = 8
    FORCE = 9


cdef class DeflectedChain:
    """One arm with its effects of readings and bodies, for one variant of the kernel.

    Args:
        geometry: The arm, of at most LARGEST_N_JOINTS joints.
        variant: One of `runnable_variants()`.
        terms: What the effects add up to, `traverse.kinematics.kernel.terms.Term`.
        levers_kg_m: What each element adds to the mass moment, (n_joints, 3).
    """

    cdef Chain chain
    cdef effects_t effects
    cdef term_t *terms
    cdef bint uses[10]
    cdef bint uses_own_temperature
    cdef bint uses_arm_temperature
    cdef object splines

    def __cinit__(self):
        self.terms = NULL

    def __dealloc__(self):
        free(self.terms)

    def __init__(self, geometry, str variant, terms, levers_kg_m):
        cdef int k, c
        cdef int n_joints = len(geometry.axes)
        if self.terms != NULL:
            raise RuntimeError("kernel: an arm with effects is made once only")
        self.chain = Chain(geometry, variant)
        elements_mm = geometry.links_mm.tolist()
        levers = levers_kg_m.tolist()
        for c in range(3):
            self.effects.probe_mm[c] = geometry.probe_vector_mm[c]
            for k in range(n_joints):
                self.effects.element_mm[k][c] = elements_mm[k][c]
                self.effects.levers_kg_m[k][c] = levers[k][c]
        self.terms = <term_t *>calloc(max(1, len(terms)), sizeof(term_t))
        if self.terms == NULL:
            raise MemoryError
        self.effects.terms = self.terms
        self.splines = []
        for term in terms:
            self._take(term, &self.terms[self.effects.n_terms])
            self.effects.n_terms += 1

    cdef int _take(self, object term, term_t *to) except -1:
        cdef int c
        cdef Floats spline
        cdef int n_joints = self.chain.arm.n_joints
        cdef bint has_source
        to.form, to.joint, to.order = term.form, term.joint, term.order
        has_source = to.form == 1 or to.form == SPLINE or to.form >= 8
        if has_source:
            to.source, to.reference = term.of.source, term.of.reference
            to.source_joint = -1 if term.of.joint is None else term.of.joint
            to.epoch_ns, to.start_ns, to.end_ns = term.of.span_ns
        if not (
            0 <= to.form <= BASE
            and 0 <= to.source <= FORCE
            and 0 <= to.joint < n_joints
            and -1 <= to.source_joint < n_joints
            and not (
                has_source and to.source <= LAST_OF_JOINT and to.source_joint < 0
            )
            and len(term.values) <= 6
        ):
            raise ValueError(
                f"kernel: {term} is no term of an arm with {n_joints} joints"
            )
        for c in range(len(term.values)):
            to.values[c] = term.values[c]
        if to.form == SPLINE:
            to.n_knots = len(term.spline) // 4
            if to.n_knots < 2 or len(term.spline) != 4 * to.n_knots:
                raise ValueError(
                    f"kernel: {term} has {len(term.spline)} numbers of a spline, "
                    "expected four for each of at least two knots"
                )
            table = np.array(term.spline)
            spline = held("spline", table, (len(table),), PyBUF_C_CONTIGUOUS)
            self.splines.append(spline)
            to.knots = spline.data()
        self.effects.moves[to.joint] |= MOVES[to.form]
        self.effects.moves_mount |= to.form == MOUNT
        self.effects.moves_base |= to.form == BASE
        self.effects.weighs |= 3 <= to.form <= MOUNT
        if has_source:
            self.uses[to.source] = True
            if to.source == TEMPERATURE:
                self.uses_own_temperature |= to.source_joint >= 0
                self.uses_arm_temperature |= to.source_joint < 0
        return 0

    @property
    def variant(self):
        """Which variant computes."""
        return self.chain.variant

    def poses(self, block, gravity_m_s2, centres_mm=None, directions=None):
        """Compute centres and directions.

        Args:
            block: `traverse.kinematics.effects.base.block.Block`, with what the effects need.
            gravity_m_s2: Three floats.
            centres_mm: Where the centres go, (n_samples, 3); new where absent.
            directions: Where the directions go, likewise.

        Returns:
            The centres and the directions.
        """
        cdef Py_ssize_t n_samples = len(block.angles_rad)
        cdef samples_t samples
        cdef int c
        cdef tuple rows = (n_samples,)
        cdef tuple table = (n_samples, self.chain.arm.n_joints)
        cdef table_t nothing = table_t(data=NULL, row=0, column=0)
        cdef Floats angles, speeds, approaches, own, temperature, utc, campaign, force
        samples.speeds_rad_s = samples.approaches = nothing
        samples.joint_temperatures_c = samples.temperature_c = nothing
        samples.utc_ns = samples.campaign_s = samples.force_n = nothing
        for c in range(3):
            samples.gravity_m_s2[c] = gravity_m_s2[c]
        angles = held("angles_rad", block.angles_rad, table, 0)
        samples.angles_rad = angles.table()
        if self.uses[2]:
            speeds = held("speeds_rad_s", block.speeds_rad_s, table, 0)
            samples.speeds_rad_s = speeds.table()
        if self.uses[3] or self.uses[4]:
            approaches = held("approaches", block.approaches, table, 0)
            samples.approaches = approaches.table()
        if self.uses[TEMPERATURE]:
            if self.uses_own_temperature and block.joint_temperatures_c is not None:
                own = held(
                    "joint_temperatures_c", block.joint_temperatures_c, table, 0
                )
                samples.joint_temperatures_c = own.table()
            if (
                self.uses_arm_temperature
                or block.joint_temperatures_c is None
                or block.temperature_c is not None
            ):
                temperature = held("temperature_c", block.temperature_c, rows, 0)
                samples.temperature_c = temperature.table()
        if self.uses[DRIFT] or self.uses[STEP]:
            utc = held("utc_ns", block.utc_ns, rows, 0, b"l")
            samples.utc_ns = utc.table()
        if self.uses[CAMPAIGN]:
            campaign = held("campaign_s", block.campaign_s, rows, 0)
            samples.campaign_s = campaign.table()
        if self.uses[FORCE]:
            force = held("force_n", block.force_n, rows, 0)
            samples.force_n = force.table()
        if centres_mm is None:
            centres_mm = np.empty((n_samples, 3))
        if directions is None:
            directions = np.empty((n_samples, 3))
        cdef Floats x = held("centres_mm", centres_mm, (n_samples, 3), PyBUF_WRITABLE)
        cdef Floats d = held("directions", directions, (n_samples, 3), PyBUF_WRITABLE)
        cdef table_t to_centres = x.table()
        cdef table_t to_directions = d.table()
        released = release_gil(n_samples)
        self.chain.code.deflected(
            &self.chain.arm,
            &self.effects,
            &samples,
            n_samples,
            to_centres,
            to_directions,
        )
        take_gil(released)
        return centres_mm, directions
