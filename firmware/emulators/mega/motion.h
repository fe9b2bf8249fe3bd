/* Positions of modelled encoders: at rest or turning steadily, in emulated time. */
#ifndef MOTION_H
#define MOTION_H

#include <stdbool.h>
#include <stdint.h>

#define MOTIONS 7U

/* Where an encoder is; `modulus` counts are a turn. */
struct motion {
    double position_counts; /* at `since_cycle`, not wrapped */
    uint64_t since_cycle;
    double counts_per_s;
    uint32_t modulus;
    bool in_step; /* its phase is moved so that latches are far from a change of count */
};

extern struct motion motions[MOTIONS];

void motion_init(uint32_t modulus, double cycles_per_s);
double motion_position(const struct motion *motion, uint64_t cycle);
uint32_t motion_count(const struct motion *motion, uint64_t cycle);
void motion_set(struct motion *motion, double position_counts, double counts_per_s, uint64_t cycle);
/* Something is latched now. */
void motion_latched(struct motion *motion, uint64_t cycle);

#endif
