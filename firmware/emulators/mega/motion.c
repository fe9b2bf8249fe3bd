#include "motion.h"

#include <math.h>

#define MARGIN 0.2 /* of a count, kept from its changes where a motion is in step */
#define MOVE 0.3

struct motion motions[MOTIONS];
static double cycles_in_s;

void motion_init(uint32_t modulus, double cycles_per_s)
{
    cycles_in_s = cycles_per_s;
    for (unsigned i = 0U; i < MOTIONS; i++) {
        motions[i] = (struct motion){.position_counts = 0.5, .modulus = modulus};
    }
}

double motion_position(const struct motion *motion, uint64_t cycle)
{
    return motion->position_counts +
           (double)(cycle - motion->since_cycle) * motion->counts_per_s / cycles_in_s;
}

uint32_t motion_count(const struct motion *motion, uint64_t cycle)
{
    const double turned = fmod(floor(motion_position(motion, cycle)), motion->modulus);
    return (uint32_t)(turned < 0.0 ? turned + motion->modulus : turned);
}

void motion_set(struct motion *motion, double position_counts, double counts_per_s, uint64_t cycle)
{
    motion->position_counts = position_counts;
    motion->counts_per_s = counts_per_s;
    motion->since_cycle = cycle;
    motion->in_step = false;
}

void motion_latched(struct motion *motion, uint64_t cycle)
{
    if (motion->in_step) {
        const double position = motion_position(motion, cycle);
        const double fraction = position - floor(position);
        if (fraction < MARGIN) {
            motion->position_counts += MOVE;
        } else if (fraction > 1.0 - MARGIN) {
            motion->position_counts -= MOVE;
        }
    }
}
