/* The effects of an arm as constants: what they move, by how much of what.
 *
 * Everything is a sum of terms. Of the readings come the turns
 *
 *     theta_k = alpha_k - alpha0_k - d_alpha_k
 *
 * of the undeflected posture, of those all that bodies do: the turn e_k, the tilt w_k,
 * the shift d_k, the growth g_k, the mount m and the base b. From the tip inwards,
 * everything written in the frame of what carries joint k,
 *
 *     v <- d_k + R(w_k) R(u_k, theta_k + e_k) (r_k (1 + g_k) + v)
 *     x  = x_0 + b + R(m) v
 */
#ifndef TRAVERSE_EFFECTS_H
#define TRAVERSE_EFFECTS_H

#include <stdint.h>

#include "arm.h"

/* What a term moves, and how it is computed; numbered as in terms.py. */
enum {
    READING_WAVE,    /* d_alpha += v0 cos(order alpha) + v1 sin(order alpha) */
    READING_RATE,    /* d_alpha += v0 source */
    READING_SPLINE,  /* d_alpha += spline(source) */
    TURN_MOMENT,     /* e += v0 (u . M) */
    TILT_MOMENT,     /* w += v0 (M - u (u . M)) */
    MOUNT_MOMENT,    /* m += v0 M_1 */
    TILT_WAVE,       /* w += (v0 v1 v2) cos(order theta) + (v3 v4 v5) sin(...) */
    SHIFT_WAVE,      /* d likewise */
    GROWTH_RATE,     /* g += v0 source */
    BASE_RATE        /* b += (v0 v1 v2) source */
};

/* What a term is computed from; numbered as in terms.py. */
enum {
    FROM_READING,     /* alpha */
    FROM_TURN,        /* alpha - alpha0 */
    FROM_SPEED,
    FROM_APPROACH,
    FROM_SENSE,       /* sign of the approach */
    FROM_TEMPERATURE, /* less the reference; the joint's own where it is known */
    FROM_DRIFT,       /* seconds from the epoch to the time held in the campaign */
    FROM_STEP,        /* 1 from so many seconds after the epoch on */
    FROM_CAMPAIGN,
    FROM_FORCE
};

typedef struct {
    int form;
    int source;
    int joint;        /* that moves */
    int source_joint; /* -1: of the arm as a whole */
    double order;
    double reference; /* of a temperature; of a step its seconds */
    int64_t epoch_ns, start_ns, end_ns;
    double values[6];
    int n_knots;
    const double *knots; /* knots, steps, values, curvatures: n_knots of each */
} term_t;

/* What may move at a joint. */
#define MOVES_READING 1
#define MOVES_TURN 2
#define MOVES_TILT 4
#define MOVES_SHIFT 8
#define MOVES_GROWTH 16

struct effects {
    int n_terms;
    const term_t *terms;
    int moves[MOST_JOINTS]; /* what moves at each joint, bits */
    int moves_mount;
    int moves_base;
    int weighs; /* whether some term asks for moments */
    double levers_kg_m[MOST_JOINTS][3];
    double element_mm[MOST_JOINTS][3]; /* r_k without the probe vector */
    double probe_mm[3];
};

/* What accompanies the readings; data is NULL where a block does not have it. */
struct samples {
    table_t angles_rad;
    table_t speeds_rad_s;
    table_t approaches;
    table_t joint_temperatures_c;
    table_t temperature_c; /* these have no columns */
    table_t utc_ns;        /* int64 */
    table_t campaign_s;
    table_t force_n;
    double gravity_m_s2[3];
};

#endif
