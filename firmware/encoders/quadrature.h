/* Incremental encoders: the part that the port's interrupts of the lines A and B do.
 *
 * Strategy: an interrupt comes with each count, so that it only adds to small counters, in
 * code without calls and loops; they are folded into counts when something is latched, at
 * least four times a second. */
#ifndef QUADRATURE_H
#define QUADRATURE_H

#include <stdint.h>

#include "settings.h"

#define QUADRATURE_CHANNELS 8 /* two banks of four */

struct quadrature_lines {
    int16_t moved[QUADRATURE_CHANNELS];    /* counts since they were folded */
    int16_t at_index[QUADRATURE_CHANNELS]; /* of these, until the index came */
    uint8_t levels[2];                     /* of a bank: A on even bits, B on odd ones */
    uint8_t skipped[2];                    /* bit 2k: channel k's lines changed both at once */
    uint8_t index;                         /* levels, bit k for channel k */
    uint8_t indexed;                       /* an index has come since the fold */
};

extern struct quadrature_lines quadrature;

/* Within an interrupt: a call would have it save all registers. */
__attribute__((always_inline)) static inline void quadrature_step(uint8_t channel, uint8_t changed, uint8_t up)
{
    if ((changed & 3U) != 0U) {
        quadrature.moved[channel] =
            (int16_t)(quadrature.moved[channel] + ((up & 1U) != 0U ? 1 : -1));
    }
}

/* Lines of a bank have changed to these levels; bit i of `index` is channel i's index. */
__attribute__((always_inline)) static inline void quadrature_changed(uint8_t bank, uint8_t levels, uint8_t index)
{
    const uint8_t before = quadrature.levels[bank];
    const uint8_t changed = before ^ levels;
    /* A leads B when counting up: then A is, after a step, what B was not before it. */
    const uint8_t up = (uint8_t)(levels ^ (before >> 1));
    const uint8_t channel = (uint8_t)(4U * bank);
    quadrature.levels[bank] = levels;
    quadrature.skipped[bank] |= (uint8_t)(changed & (changed >> 1));
    quadrature_step(channel, changed, up);
    quadrature_step((uint8_t)(channel + 1U), changed >> 2, up >> 2);
    quadrature_step((uint8_t)(channel + 2U), changed >> 4, up >> 4);
    quadrature_step((uint8_t)(channel + 3U), changed >> 6, up >> 6);
#if INDEX_WIRED
    const uint8_t come = (uint8_t)(index & (uint8_t)~quadrature.index);
    quadrature.index = index;
    if (come != 0U) {
        quadrature.indexed |= come;
        for (uint8_t i = 0U; i < CHANNELS; i++) {
            if (((unsigned)come >> i & 1U) != 0U) {
                quadrature.at_index[i] = quadrature.moved[i];
            }
        }
    }
#else
    (void)index;
#endif
}

#endif
