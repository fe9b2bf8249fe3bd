/* An arm as constants, and what every variant of the kernel computes from it.
 *
 * With R(u_k, theta_k) the turn of joint k, everything written in the base posture,
 *
 *     P_k = R(u_1, theta_1) ... R(u_k, theta_k)      theta_k = alpha_k - alpha0_k
 *     x   = x_0 + sum_k P_k r_k,   r_n with the probe vector
 *
 * A variant is the same source compiled for another set of instructions. Arithmetic is
 * strict IEEE without contraction, elementwise over samples: all variants give the same
 * bits, wherever in a block a sample stands.
 */
#ifndef TRAVERSE_ARM_H
#define TRAVERSE_ARM_H

#include <stddef.h>

#define MOST_JOINTS 32

typedef struct {
    int n_joints;
    double origin_mm[3];           /* x_0 */
    double direction[3];           /* d */
    double zeros_rad[MOST_JOINTS]; /* alpha0_k; all zero beyond n_joints */
    double axes[MOST_JOINTS][3];   /* u_k */
    double links_mm[MOST_JOINTS][3]; /* r_k; the last one with the probe vector */
} arm_t;

/* A float64 array of two dimensions, strides in bytes. */
typedef struct {
    char *data;
    ptrdiff_t row;
    ptrdiff_t column;
} table_t;

/* Where derivatives go: C-contiguous arrays of the shapes of ProbeDerivatives. */
typedef struct {
    double *centres_mm; /* (n, 3) */
    double *by_angles;  /* (n, 3, n_joints) */
    double *by_axes;    /* (n, 3, n_joints, 3) */
    double *by_links;   /* (n, 3, n_joints, 3) */
} derivatives_t;

/* The effects of an arm and what accompanies its readings: effects.h. */
typedef struct effects effects_t;
typedef struct samples samples_t;

typedef struct {
    const char *name;
    /* Centres (n, 3) and, where wanted, directions (n, 3). */
    void (*poses)(const arm_t *arm, table_t angles_rad, ptrdiff_t n_samples,
                  table_t centres_mm, table_t directions);
    /* Origins of the joints and the centre (n, n_joints + 1, 3); where wanted the
     * rotations P_k (n, n_joints, 3, 3). Both C-contiguous. */
    void (*skeletons)(const arm_t *arm, table_t angles_rad, ptrdiff_t n_samples,
                      double *positions_mm, double *rotations);
    void (*derivatives)(const arm_t *arm, table_t angles_rad, ptrdiff_t n_samples,
                        derivatives_t out);
    /* One sample: reading k at angles_rad[k]. */
    void (*pose)(const arm_t *arm, const double *angles_rad, double *centre_mm,
                 double *direction);
    /* Centres (n, 3) and directions (n, 3) with the effects of readings and bodies. */
    void (*deflected)(const arm_t *arm, const effects_t *effects,
                      const samples_t *samples, ptrdiff_t n_samples,
                      table_t centres_mm, table_t directions);
} variant_t;

/* The variants in rising order of speed, and whether this processor runs them. */
#define N_VARIANTS 3
const variant_t *variant_at(int which); /* NULL where it is not built */
int variant_runs(int which);

#endif
