/* Inputs: every change latched in its interrupt, debounced in the main loop. */
#ifndef LB_INPUTS_H
#define LB_INPUTS_H

#include <stdbool.h>
#include <stdint.h>

#include "message.h"

/* An input that has changed and is not yet at rest. */
struct lb_bounce {
    bool active;
    uint64_t last_tick;    /* of the latest change, unwrapped */
    struct lb_latch latch; /* at the first one */
};

struct lb_inputs {
    const struct lb_identity *identity;
    const struct lb_port *port;
    /* Shared with interrupts, under lock. */
    uint8_t first; /* place in the ring of the oldest that waits */
    uint8_t n_waiting;
    bool overflowed;
    struct lb_latch ring[LB_CHANGE_QUEUE];
    /* The main loop's own; bit i is input i. */
    uint8_t levels;   /* after the changes processed so far */
    uint8_t reported; /* debounced */
    uint64_t debounce_ticks;
    struct lb_bounce bounces[LB_MAX_INPUTS];
};

/* A change that has held. */
struct lb_held {
    uint8_t input;
    uint8_t level;
    const struct lb_latch *latch; /* until lb_inputs_next is called again */
};

void lb_inputs_init(struct lb_inputs *inputs, const struct lb_identity *identity,
                    const struct lb_port *port);
void lb_inputs_debounce(struct lb_inputs *inputs, uint32_t debounce_us);

/* See lb_inputs_changed. */
void lb_inputs_change(struct lb_inputs *inputs, uint32_t earliest, uint32_t tick,
                      uint8_t levels);

/* Find the next change that has held until now, in the order in which they came to rest.
 * Call until it returns false; `now` is unwrapped. */
bool lb_inputs_next(struct lb_inputs *inputs, uint64_t now, struct lb_held *held);

#endif
